"""The fault plan as text."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import msgspec

from fleet.faults import registry
from fleet.faults.rules import Rule


def plan_json(plan: Sequence[Rule]) -> str:
    """A plan as text."""
    return msgspec.json.encode(plan).decode()


def plan_of(text: str) -> tuple[Rule, ...]:
    """The plan of such a text; raises ValueError."""
    try:
        return _decoder().decode(text)
    except RecursionError as error:
        raise ValueError("a fault plan is nested too deeply") from error


@functools.cache
def _decoder() -> msgspec.json.Decoder[tuple[registry.FaultRule, ...]]:
    return msgspec.json.Decoder(tuple[registry.FaultRule, ...])
