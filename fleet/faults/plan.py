"""The fault plan: all kinds of rules together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import msgspec

from fleet.faults.burst import Burst
from fleet.faults.clock import ClockError
from fleet.faults.corrupt import Corrupt
from fleet.faults.duplicate import Duplicate
from fleet.faults.latency import Latency
from fleet.faults.lifecycle import Kill, Pause, Slow
from fleet.faults.loss import Loss
from fleet.faults.navigation import Navigation
from fleet.faults.partition import Partition
from fleet.faults.range import Range
from fleet.faults.rate import Rate
from fleet.faults.reorder import Reorder
from fleet.faults.replay import Replay

FaultRule = (
    Latency
    | Loss
    | Burst
    | Range
    | Partition
    | Duplicate
    | Replay
    | Reorder
    | Corrupt
    | Rate
    | ClockError
    | Navigation
    | Kill
    | Pause
    | Slow
)

_plans = msgspec.json.Decoder(tuple[FaultRule, ...])

FAULTS = {str(rule.__struct_config__.tag): rule for rule in get_args(FaultRule)}
"""The class of each kind of rule."""

FAULT_KINDS = tuple(FAULTS)


def plan_json(plan: Sequence[FaultRule]) -> str:
    """A plan as text."""
    return msgspec.json.encode(plan).decode()


def plan_of(text: str) -> tuple[FaultRule, ...]:
    """The plan of such a text; raises ValueError."""
    try:
        return _plans.decode(text)
    except RecursionError as error:
        raise ValueError("a fault plan is nested too deeply") from error
