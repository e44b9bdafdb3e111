"""The result of a run: as tables for people and as JSON for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import msgspec
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from fleet.analysis.separation import PairMinimum
from fleet.analysis.tally import RunTally, binned_quantiles_s, quantiles
from fleet.analysis.words import arrival_text, counted, enumerated, separation_text
from fleet.config.checks import leaderless
from fleet.config.idle_rules import idle_rules
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.faults.duplicate import Duplicate
from fleet.faults.plan import FaultRule
from fleet.faults.replay import Replay
from fleet.protocol.messages import AUDIBLE
from fleet.simulation.simulation import RunOutcome

PAIRS_SHOWN = 10
PAIRS_TOLD, LOST_TOLD = 20, 200
"""As JSON: so many pairs, the nearest; of those that lost separation so many."""
REJECTED_SHOWN = 5


def result_json(outcome: RunOutcome) -> dict[str, Any]:
    """The whole result; SI units, latencies and times in seconds."""
    run_recorder, scenario = outcome.run_recorder, outcome.options.scenario
    arrivals = run_recorder.arrivals.arrivals()
    tally, realtime = run_recorder.tally, outcome.options.clock == "realtime"
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
        **separation_json(run_recorder.separation.minima()),
        **arrivals.totals(),
        "arrivals": [asdict(row) for row in arrivals.rows],
        "elections": len(tally.terms),
        "commands": {
            "issued": len(tally.issued),
            "transmissions": tally.transmissions,
            "applied": len(tally.applied),
            "refused": sum(tally.refused.values()),
            "refused_by_reason": dict(sorted(tally.refused.items())),
            "latency_s": quantiles(list(tally.applied.values())),
        },
        "unresolved": tally.unresolved,
        "leaderless": sorted(tally.leaderless),
        "delivery": _delivery(tally, outcome.plan),
        "faults": len(outcome.plan),
        "messages": dict(sorted(run_recorder.messages.items())),
        "rejected": [
            {"topic": topic, "why": why, "count": n}
            for (topic, why), n in sorted(run_recorder.rejected.items())
        ],
        "log": str(outcome.options.out) if outcome.options.out and outcome.logged else "",
    }
    if realtime:
        result["late_steps"] = {"count": len(tally.late_s), **quantiles(tally.late_s)}
        result["zenoh_latency_s"] = binned_quantiles_s(tally.transits)
        result["injected_delay"] = tally.accuracy()
    return result


def separation_json(minima: Sequence[PairMinimum]) -> dict[str, Any]:
    """How near the pairs came: least and counts of all, and a list of the nearest ones.

    Every pair that lost separation is in the list, up to `LOST_TOLD` of them.
    """
    lost = sum(m.lost for m in minima)
    told = minima[: max(PAIRS_TOLD, min(lost, LOST_TOLD))]
    return {
        "least_separation": minima[0].least_separation if minima else None,
        "pairs": len(minima),
        "pairs_lost": lost,
        "nearest_pairs": [asdict(m) for m in told],
        "pairs_left_out": len(minima) - len(told),
    }


def _delivery(tally: RunTally, plan: Sequence[FaultRule]) -> dict[str, Any]:
    """By class of message: sent (times receivers), received, dropped by which fault, and when.

    What no receiver reports went to a process that was down, or was still under way at the end. How
    much that is cannot be told from sums where faults multiply messages.
    """
    multiplied = any(isinstance(rule, Duplicate | Replay) for rule in plan)
    out: dict[str, Any] = {}
    for kind in sorted(AUDIBLE):
        fates = {fate: n for (k, fate), n in sorted(tally.fates.items()) if k == kind}
        came = {fate: fates.pop(fate, 0) for fate in ("received", "altered", "implausible")}
        if not tally.sent[kind]:
            continue
        out[kind] = {
            "messages": tally.transmitted[kind],
            "sent": tally.sent[kind],
            "delivered": sum(came.values()),
            "altered": came["altered"],
            "implausible": came["implausible"],
            "dropped": fates,
            "unreported": None
            if multiplied
            else tally.sent[kind] - sum(came.values()) - sum(fates.values()),
            "latency_s": binned_quantiles_s(tally.latencies[kind]),
        }
    return out


def fault_lines(plan: Sequence[FaultRule]) -> list[str]:
    """The effective fault plan, a line a rule, without what is as by default; empty if none."""
    lines = []
    for rule in plan:
        fields = msgspec.structs.fields(rule)
        given = [
            f"{f.encode_name}={_plain(getattr(rule, f.name))}"
            for f in fields
            if getattr(rule, f.name) != f.default
        ]
        lines.append(" ".join([f"fault: {rule.name}", *given]))
    return lines


def warning_lines(scenario: Scenario, *, realtime: bool) -> list[str]:
    """A warning if nobody can lead, and for each rule of the plan that does nothing in this run."""
    found = [*filter(None, [leaderless(scenario)]), *idle_rules(scenario, realtime=realtime)]
    return [f"fleet: warning: {why}" for why in found]


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def result_tables(outcome: RunOutcome) -> list[RenderableType]:
    """The result as a table of the nearest pairs and a table of facts."""
    result = result_json(outcome)
    return [_pairs(result), _facts(result)]


def _pairs(result: dict[str, Any]) -> Table:
    table = Table(title="Least separation of each pair", title_justify="left")
    for column in ("pair", "normalised", "horizontal m", "vertical m", "at s", ""):
        table.add_column(column, justify="right" if column else "left")
    for m in result["nearest_pairs"][:PAIRS_SHOWN]:
        lost = m["least_separation"] < 1.0
        table.add_row(
            f"{m['a']}-{m['b']}",
            separation_text(m["least_separation"]),
            f"{m['horizontal_m']:.1f}",
            f"{m['vertical_m']:.1f}",
            f"{m['t_s']:.1f}",
            "[bold red]LOSS[/]" if lost else "[green]kept[/]",
        )
    if result["pairs"] > PAIRS_SHOWN:
        table.caption = f"the {PAIRS_SHOWN} nearest of {result['pairs']} pairs"
    return table


def _facts(result: dict[str, Any]) -> Table:
    commands = result["commands"]
    table = Table(show_header=False)
    table.add_column()
    table.add_column(overflow="fold")
    table.add_row("scenario", f"{result['scenario']}, {result['uavs']} UAVs, seed {result['seed']}")
    table.add_row(
        "lost separation", f"{result['pairs_lost']} of {counted(result['pairs'], 'pair')}"
    )
    table.add_row("all arrived", arrival_text(result, result["uavs"]))
    others = others_text(result["arrivals"])
    if others:
        table.add_row("of the UAVs", others)
    table.add_row("elections", str(result["elections"]))
    refused = ", ".join(f"{k} {n}" for k, n in commands["refused_by_reason"].items())
    table.add_row(
        "commands",
        commands_words(commands) + (f" ({refused})" if refused else ""),
    )
    if commands["latency_s"]:
        table.add_row("issue to actuation", _spread(commands["latency_s"], 1.0, "s"))
    for kind, row in result["delivery"].items() if result["faults"] else ():
        table.add_row(f"delivery of {kind}", _delivery_words(row))
    table.add_row("unresolved encounters", str(result["unresolved"]))
    if result["leaderless"]:
        led_by_nobody = ", ".join(map(str, result["leaderless"]))
        table.add_row("in conflict, no leader", f"[yellow]UAV {led_by_nobody}[/]")
    if result["rejected"]:
        table.add_row("rejected messages", f"[yellow]{escape(_rejected(result['rejected']))}[/]")
    if "late_steps" in result:
        late = result["late_steps"]
        spread = f", {_spread(late, 1e3, 'ms')}" if late["count"] else ""
        table.add_row("late steps", f"{late['count']}{spread}")
        table.add_row("zenoh latency", _spread(result["zenoh_latency_s"], 1e3, "ms"))
        injected = result["injected_delay"]
        if injected["count"]:
            table.add_row("slip of injected delays", _spread(injected["slip_s"], 1e3, "ms"))
        if injected["degraded"]:
            table.add_row("degraded", "[bold red]the machine was too slow for the delays[/]")
    else:
        table.add_row("digest", result["digest"])
    table.add_row(
        "time",
        f"{result['sim_s']:g} s in {result['wall_s']:.2f} s: {result['speed']:.1f} times real time"
        f" (start-up {result['start_s']:.2f} s)",
    )
    table.add_row("log", escape(result["log"]) or "none")
    return table


def others_text(arrivals: Sequence[dict[str, Any]]) -> str:
    """Who is not flown to the end, and who is off its plan then; empty if nobody is."""
    found = {
        how: [row["id"] for row in arrivals if row["aircraft"] == how]
        for how in ("unmanned", "vanished", "unseen")
    }
    found["off plan at the end"] = [row["id"] for row in arrivals if not row["back_on_plan"]]
    return "; ".join(f"{how}: {enumerated(uavs)}" for how, uavs in found.items() if uavs)


def commands_words(commands: dict[str, Any]) -> str:
    """As in `14 issued in 31 transmissions, 14 applied, 0 refusals`."""
    sent = counted(commands["transmissions"], "transmission")
    refusals = counted(commands["refused"], "refusal")
    return f"{commands['issued']} issued in {sent}, {commands['applied']} applied, {refusals}"


def _rejected(rows: list[dict[str, Any]]) -> str:
    """What was not taken for a message of the run: how many, on which topics, why."""
    first = ", ".join(f"{r['count']} on {r['topic']} ({r['why']})" for r in rows[:REJECTED_SHOWN])
    more = len(rows) - REJECTED_SHOWN
    return first + (f", and on {more} topics more" if more > 0 else "")


def _delivery_words(row: dict[str, Any]) -> str:
    words = [f"{row['sent']} sent", f"{row['delivered']} delivered"]
    words += [f"{row[k]} {k}" for k in ("altered", "implausible") if row[k]]
    words += [f"{n} dropped by {fault}" for fault, n in row["dropped"].items()]
    if row["unreported"]:
        words.append(f"{row['unreported']} not taken: process down, or end of run")
    if row["latency_s"]:
        words.append(f"after {_spread(row['latency_s'], 1.0, 's')}")
    return ", ".join(words)


def _spread(values: dict[str, float], factor: float, unit: str) -> str:
    return ", ".join(
        f"{name} {factor * values[name]:.3g} {unit}"
        for name in ("p50", "p99", "max")
        if name in values
    )
