"""The whole result of a run that has ended: what came of it, and how it was run."""

from __future__ import annotations

from typing import Any

import msgspec

from fleet.analysis.result import result_of
from fleet.analysis.tally import binned_quantiles_s, quantiles
from fleet.config.traffic import uavs_of
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
    if run_recorder.rounds_s:
        update_s = scenario.coordination.update_s
        rounds = run_recorder.rounds_s
        result["rounds"] = {
            "count": len(rounds),
            "too_long": len([took_s for took_s in rounds if took_s > update_s]),
            **quantiles(rounds),
        }
    if realtime:
        result["late_steps"] = {"count": len(tally.late_s), **quantiles(tally.late_s)}
        result["zenoh_latency_s"] = binned_quantiles_s(tally.transits)
        result["injected_delay"] = tally.accuracy()
        result["outages"] = outages_json(run_recorder.outages)
        result["clocks"] = tally.clocks.account().record()
    return result
