"""The result of a run, as tables for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from fleet.analysis.words import (
    arrival_text,
    clock_text,
    counted,
    enumerated,
    outage_text,
    separation_text,
    shortage_text,
)
from fleet.config.checks import leaderless
from fleet.config.idle_rules import idle_rules
from fleet.config.scenario import Scenario
from fleet.faults.options import RuleTable, by_option
from fleet.faults.rules import Rule

PAIRS_SHOWN = 10
REJECTED_SHOWN = 5


def fault_lines(plan: Sequence[Rule]) -> list[str]:
    """The effective fault plan, a line a rule; empty if there is none."""
    return [f"fault: {rule.words(when=True)}" for rule in plan]


def warning_lines(
    scenario: Scenario, options: Sequence[RuleTable] = (), *, realtime: bool
) -> list[str]:
    """A warning if nobody can lead, and for each rule of the plan that does nothing in this run.

    The last rules of the plan are those of `options`, and named so.
    """
    first = len(scenario.fault) - len(options)
    idle = [by_option(why, first, options) for why in idle_rules(scenario, realtime=realtime)]
    return [f"fleet: warning: {why}" for why in (leaderless(scenario), *idle) if why]


def result_tables(result: dict[str, Any]) -> list[RenderableType]:
    """The result as a table of the nearest pairs and a table of facts."""
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
        table.add_row("no computing UAV for", f"[yellow]UAV {led_by_nobody}[/]")
    if result["rejected"]:
        table.add_row("rejected messages", f"[yellow]{escape(_rejected(result['rejected']))}[/]")
    if result["lacked_room"]:
        told = shortage_text(result["lacked_room"])
        table.add_row("dropped for lack of room", f"[yellow]{escape(told)}[/]")
    if "late_steps" in result:
        _add_realtime(table, result)
    else:
        table.add_row("digest", result["digest"])
    table.add_row(
        "time",
        f"{result['sim_s']:g} s in {result['wall_s']:.2f} s: {result['speed']:.1f} times real time"
        f" (start-up {result['start_s']:.2f} s)",
    )
    table.add_row("log", _log_words(result))
    return table


def _log_words(result: dict[str, Any]) -> str:
    """Where the log is, and where it ends if that is before its run."""
    log, end = escape(result["log"]) or "none", result.get("log_end")
    if end is None:
        return log
    where = "" if end["tick"] is None else f", ends in tick {end['tick']}"
    return f"[yellow]{log}{where}[/]"


def _add_realtime(table: Table, result: dict[str, Any]) -> None:
    """What only realtime measures."""
    if "rounds" in result:
        table.add_row("rounds of the resolver", rounds_words(result["rounds"]))
    late, injected, clocks = result["late_steps"], result["injected_delay"], result["clocks"]
    spread = f", {_spread(late, 1e3, 'ms')}" if late["count"] else ""
    table.add_row("late steps", f"{late['count']}{spread}")
    table.add_row("zenoh latency", _spread(result["zenoh_latency_s"], 1e3, "ms"))
    if injected["count"]:
        table.add_row("slip of injected delays", _spread(injected["slip_s"], 1e3, "ms"))
    if result["outages"]:
        table.add_row("not heard", f"[yellow]{escape(outage_text(result['outages']))}[/]")
    told = escape(clock_text(clocks))
    table.add_row("wall clocks", f"[yellow]{told}[/]" if clocks["warned"] else told)
    why = ["the machine was too slow for the delays"] if injected["degraded"] else []
    why += ["wall clocks are more than a tick apart"] if clocks["degraded"] else []
    if why:
        table.add_row("degraded", f"[bold red]{'; '.join(why)}[/]")


def rounds_words(rounds: dict[str, Any]) -> str:
    """As in `378, p50 1.1, p99 2.0, max 24.3 ms, 2 longer than the update period`."""
    told = f"{rounds['count']}, {_spread(rounds, 1e3, 'ms')}"
    if rounds["too_long"]:
        told += f", [yellow]{rounds['too_long']} longer than the update period[/]"
    return told


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
