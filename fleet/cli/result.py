"""The result of a run: as tables for people and as JSON for programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import msgspec
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from fleet.analysis.tally import Tally, binned_quantiles_s, quantiles
from fleet.model.generate import uavs_of
from fleet.model.scenario import Scenario
from fleet.run.range import Outcome

PAIRS_SHOWN = 10


def result_json(outcome: Outcome) -> dict[str, Any]:
    """The whole result; SI units, latencies and times in seconds."""
    ledger, scenario = outcome.ledger, outcome.options.scenario
    tally, realtime = ledger.tally, outcome.options.clock == "realtime"
    result = {
        "scenario": scenario.name,
        "status": outcome.status,
        "why": outcome.why,
        "seed": scenario.seed,
        "clock": outcome.options.clock,
        "bus": outcome.options.bus,
        "resolver": scenario.resolver,
        "digest": ledger.digest,
        "ticks": outcome.ticks,
        "sim_s": outcome.sim_s,
        "wall_s": round(outcome.wall_s, 4),
        "start_s": round(outcome.start_s, 4),
        "speed": round(outcome.sim_s / outcome.wall_s, 2) if outcome.wall_s else 0.0,
        "uavs": len(uavs_of(scenario)),
        "loss_of_separation": ledger.separation.lost(),
        "min_separation": [asdict(m) for m in ledger.separation.minima()],
        "elections": len(tally.terms),
        "commands": {
            "sent": len(tally.issued),
            "transmissions": tally.transmissions,
            "applied": len(tally.applied),
            "refused": sum(tally.refused.values()),
            "refused_by_reason": dict(sorted(tally.refused.items())),
            "latency_s": quantiles(list(tally.applied.values())),
        },
        "unresolved": tally.unresolved,
        "delivery": _delivery(tally),
        "faults": len(scenario.fault),
        "messages": dict(sorted(ledger.messages.items())),
        "log": str(outcome.options.out) if outcome.options.out else "",
    }
    if realtime:
        result["late_steps"] = {"count": len(tally.late_s), **quantiles(tally.late_s)}
        result["zenoh_latency_s"] = binned_quantiles_s(tally.transits)
        result["message_age_s"] = binned_quantiles_s(tally.ages)
    return result


def _delivery(tally: Tally) -> dict[str, Any]:
    """By class of message: received, and dropped by which fault; counted once a receiver."""
    out: dict[str, Any] = {}
    for (kind, fate), count in sorted(tally.fates.items()):
        row = out.setdefault(kind, {"received": 0, "altered": 0, "dropped": {}})
        if fate in row:
            row[fate] += count
        else:
            row["dropped"][fate] = count
    return out


def fault_lines(scenario: Scenario) -> list[str]:
    """The effective fault plan, a line a rule; nothing where there is none."""
    lines = []
    for rule in scenario.fault:
        fields = msgspec.to_builtins(rule)
        kind = fields.pop("kind")
        fields = {k: v for k, v in fields.items() if v is not None}
        lines.append(f"fault: {kind} " + " ".join(f"{k}={v}" for k, v in fields.items()))
    return lines


def result_tables(outcome: Outcome) -> list[RenderableType]:
    """The result as a table of the nearest pairs and a table of facts."""
    result = result_json(outcome)
    return [_pairs(result), _facts(result)]


def _pairs(result: dict[str, Any]) -> Table:
    table = Table(title="Least separation of each pair", title_justify="left")
    for column in ("pair", "normalised", "horizontal m", "vertical m", "at s", ""):
        table.add_column(column, justify="right" if column else "left")
    minima = result["min_separation"]
    for m in minima[:PAIRS_SHOWN]:
        lost = m["normalised"] < 1.0
        table.add_row(
            f"{m['a']}-{m['b']}",
            f"{m['normalised']:.3f}",
            f"{m['horizontal_m']:.1f}",
            f"{m['vertical_m']:.1f}",
            f"{m['t_s']:.1f}",
            "[bold red]LOSS[/]" if lost else "[green]kept[/]",
        )
    if len(minima) > PAIRS_SHOWN:
        table.caption = f"the {PAIRS_SHOWN} nearest of {len(minima)} pairs"
    return table


def _facts(result: dict[str, Any]) -> Table:
    commands, minima = result["commands"], result["min_separation"]
    losses = sum(m["normalised"] < 1.0 for m in minima)
    table = Table(show_header=False)
    table.add_column()
    table.add_column(overflow="fold")
    table.add_row("scenario", f"{result['scenario']}, {result['uavs']} UAVs, seed {result['seed']}")
    table.add_row("losses of separation", f"{losses} of {len(minima)} pairs")
    table.add_row("elections", str(result["elections"]))
    refused = ", ".join(f"{k} {n}" for k, n in commands["refused_by_reason"].items())
    table.add_row(
        "commands",
        f"{commands['sent']} sent, {commands['applied']} applied, {commands['refused']} refused"
        + (f" ({refused})" if refused else ""),
    )
    if commands["latency_s"]:
        table.add_row("issue to actuation", _spread(commands["latency_s"], 1.0, "s"))
    for kind, row in result["delivery"].items() if result["faults"] else ():
        dropped = ", ".join(f"{k} {n}" for k, n in row["dropped"].items()) or "none"
        altered = f", {row['altered']} of them altered" if row["altered"] else ""
        table.add_row(
            f"delivery of {kind}", f"{row['received']} received{altered}; dropped: {dropped}"
        )
    table.add_row("unresolved encounters", str(result["unresolved"]))
    if "late_steps" in result:
        late = result["late_steps"]
        spread = f", {_spread(late, 1e3, 'ms')}" if late["count"] else ""
        table.add_row("late steps", f"{late['count']}{spread}")
        table.add_row("zenoh latency", _spread(result["zenoh_latency_s"], 1e3, "ms"))
        table.add_row("age on delivery", _spread(result["message_age_s"], 1e3, "ms"))
    else:
        table.add_row("digest", result["digest"])
    table.add_row(
        "time",
        f"{result['sim_s']:g} s in {result['wall_s']:.2f} s: {result['speed']:.1f} times real time"
        f" (start-up {result['start_s']:.2f} s)",
    )
    table.add_row("log", escape(result["log"]) or "none")
    return table


def _spread(values: dict[str, float], factor: float, unit: str) -> str:
    return ", ".join(
        f"{name} {factor * values[name]:.3g} {unit}"
        for name in ("p50", "p99", "max")
        if name in values
    )
