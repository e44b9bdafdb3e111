"""A what-if beside the run that it departs from: one side of that, from what is on record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec

from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.result import result_of
from fleet.analysis.run_summary import RunSummary
from fleet.analysis.separation import PairMinimum
from fleet.config.traffic import uavs_of
from fleet.faults.rules import Rule
from fleet.model.words import ClockMode
from fleet.protocol.messages import Clock, Truth

COMPARED = (
    "least_separation",
    "pairs",
    "pairs_lost",
    "nearest_pairs",
    "pairs_left_out",
    "all_arrived",
    "arrived",
    "due",
    "not_arrived",
    "delay_mean_s",
    "delay_max_s",
    "arrivals",
    "elections",
    "commands",
    "unresolved",
    "delivery",
)
"""What of a result can be compared."""


@dataclass(frozen=True)
class WhatIfSide:
    """What came of one run: as a map for programs, and every pair's minimum, nearest first."""

    result: dict[str, Any]
    minima: tuple[PairMinimum, ...]
    plan: tuple[Rule, ...]


def side_of(run: RecordedRun) -> WhatIfSide:
    """One side, from the messages alone; what cannot be of the run is left out."""
    summary, moments = RunSummary(run.scenario), set[int]()
    for message in run.messages():
        if isinstance(message, Clock):
            continue
        summary.add(message)
        if isinstance(message, Truth):
            moments.add(message.t_ns)
    summary.finish()
    found = result_of(summary, run.plan)
    result = {
        "status": run.about.status or "cut short",
        "seed": run.scenario.seed,
        "clock": ClockMode.REALTIME if run.realtime else ClockMode.LOCKSTEP,
        "digest": run.digest,
        "ticks": len(moments),
        "sim_s": max(moments, default=0) / 1e9,
        "uavs": len(uavs_of(run.scenario)),
        **{name: found[name] for name in COMPARED},
        "fault_plan": msgspec.to_builtins(run.plan),
    }
    return WhatIfSide(result, tuple(summary.separation.minima()), run.plan)
