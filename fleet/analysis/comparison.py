"""Runs side by side: in which settings they differ, and what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from fleet.analysis.metrics import RunMetrics

ALWAYS = ("name", "seed", "fault")
"""Settings that are told though they do not differ."""

SideBySide = dict[str, list[Any]]
"""A value for each run, by name."""


def comparison(runs: Sequence[RunMetrics]) -> dict[str, SideBySide]:
    """`settings`, those that differ first, and `results`."""
    told = [_settings(run) for run in runs]
    names = dict.fromkeys(name for settings in told for name in settings)
    columns = {name: [settings.get(name) for settings in told] for name in names}
    differing = [name for name, values in columns.items() if any(v != values[0] for v in values)]
    shown = dict.fromkeys([*differing, *ALWAYS])
    results = [_results(run) for run in runs]
    found = dict.fromkeys(name for result in results for name in result)
    return {
        "settings": {name: columns[name] for name in shown},
        "results": {name: [result.get(name) for result in results] for name in found},
    }


def _settings(run: RunMetrics) -> dict[str, Any]:
    """All settings of a run by dotted name; the faults are those in force at its end."""
    table = msgspec.to_builtins(run.scenario)
    del table["description"], table["fault"]
    faults = [rule.words(when=True) for rule in run.plan]
    clock = "realtime" if run.realtime else "lockstep"
    return {
        "name": table.pop("name"),
        "seed": table.pop("seed"),
        "fault": faults,
        "clock": clock,
    } | _flat(table)


def _flat(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            out |= _flat(value, f"{prefix}{key}.")
        elif key == "uav":
            for uav in value:
                out |= _flat(uav, f"{prefix}uav.{uav['id']}.")
        else:
            out[f"{prefix}{key}"] = value
    return out


def _results(run: RunMetrics) -> dict[str, Any]:
    totals, commands, elections = run.totals, run.commands, run.elections
    out = {
        "least_separation": totals.least_separation,
        "losses": totals.losses,
        "pairs_lost": totals.pairs_lost,
        "loss_s": totals.loss_s,
        "severity": totals.severity,
        **{f"incursions_{name}": count for name, count in totals.incursions.items()},
        "all_arrived": totals.all_arrived,
        "arrived": totals.arrived,
        "due": totals.due,
        "delay_mean_s": totals.delay_mean_s,
        "delay_max_s": totals.delay_max_s,
        "off_plan_at_end": sum(not uav.back_on_plan for uav in run.uavs),
        "pairs_alerted": totals.pairs_alerted,
        "missed_alerts": totals.missed_alerts,
        "commands_issued": commands.issued,
        "commands_applied": commands.applied,
        "commands_refused": commands.refused,
        "commands_unanswered": commands.unanswered,
        "command_latency_s_p50": commands.latency_s.p50,
        "command_latency_s_max": commands.latency_s.max,
        "state_age_s_mean": commands.state_age_s.mean,
        "unresolved": commands.unresolved,
        "elections": elections.terms,
        "election_changes": elections.changes,
        "at_risk_s": elections.at_risk_s,
        "without_computing_s": elections.without_computing_s,
        "path_deviation_max_m": totals.path_deviation_max_m,
        "altitude_deviation_max_m": totals.altitude_deviation_max_m,
        "off_plan_s": sum(uav.off_plan_s for uav in run.uavs),
    }
    for row in run.classes:
        out[f"delivery_ratio_{row.kind}"] = row.delivery_ratio
    for row in run.classes:
        out[f"expected_ratio_{row.kind}"] = row.expected_ratio
    return {**out, "measured_s": run.end_s, "complete": run.complete}
