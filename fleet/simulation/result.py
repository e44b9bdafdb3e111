"""The whole result of a run that has ended: what came of it, and how it was run."""

from __future__ import annotations

from collections import Counter
from typing import Any

import msgspec

from fleet.analysis.latency_bins import binned_quantiles_s, latency_bin
from fleet.analysis.result import result_of
from fleet.config.traffic import uavs_of
from fleet.model.units import to_ns
from fleet.model.words import ClockMode
from fleet.simulation.outages import outages_json
from fleet.simulation.simulation import RunOutcome


def result_json(outcome: RunOutcome) -> dict[str, Any]:
    """The whole result; SI units, latencies and times in seconds."""
    run_recorder, scenario = outcome.run_recorder, outcome.options.scenario
    tally, realtime = run_recorder.tally, outcome.options.clock == ClockMode.REALTIME
    result = {
        "scenario": scenario.name,
        "status": outcome.status,
        "why": outcome.why,
        "seed": scenario.seed,
        "clock": outcome.options.clock,
        "bus": outcome.options.bus,
        "resolver": scenario.resolver,
        "digest": run_recorder.digest,
        "ticks": outcome.ticks,
        "sim_s": outcome.sim_s,
        "wall_s": round(outcome.wall_s, 4),
        "start_s": round(outcome.start_s, 4),
        "speed": round(outcome.sim_s / outcome.wall_s, 2) if outcome.wall_s else 0.0,
        "uavs": len(uavs_of(scenario)),
        **result_of(run_recorder, outcome.plan),
        "rejected": [
            {"topic": topic, "why": why, "count": n}
            for (topic, why), n in sorted(run_recorder.rejected.items())
        ],
        "lacked_room": outcome.shortages.counts(),
        "log": str(outcome.log or ""),
    }
    if outcome.log_end is not None:
        result["log_end"] = msgspec.to_builtins(outcome.log_end)
    if run_recorder.rounds:
        update_s = scenario.coordination.update_s
        rounds, longest = run_recorder.rounds, latency_bin(to_ns(update_s))
        result["rounds"] = {
            "count": rounds.total(),
            "too_long": Counter({b: n for b, n in rounds.items() if b > longest}).total(),
            **binned_quantiles_s(rounds),
        }
    if realtime:
        result["late_steps"] = {"count": tally.late.total(), **binned_quantiles_s(tally.late)}
        result["zenoh_latency_s"] = binned_quantiles_s(tally.transits)
        result["injected_delay"] = tally.accuracy()
        result["outages"] = outages_json(run_recorder.outages)
        result["clocks"] = tally.clocks.account().record()
    return result
