"""A what-if beside the run that it departs from: as a table for people, as JSON for programs."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import tomli_w
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from fleet.analysis.participant_filter import ParticipantFilter
from fleet.analysis.separation import PairMinimum
from fleet.analysis.words import arrival_text, counted, separation_text
from fleet.cli.faults import Given, fault_tables
from fleet.cli.result import commands_words, fault_lines, others_text, result_json
from fleet.config.loading import load_scenario, with_faults
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError
from fleet.protocol.messages import Truth
from fleet.protocol.topics import SIMULATION_TOPICS
from fleet.replay.logged_run import LoggedRun
from fleet.simulation.run_recorder import RunRecorder
from fleet.simulation.simulation import RunOptions, RunOutcome

FACTS_SHOWN = (
    "status",
    "seed",
    "clock",
    "digest",
    "ticks",
    "sim_s",
    "least_separation",
    "pairs",
    "pairs_lost",
    "nearest_pairs",
    "pairs_left_out",
    "uavs",
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
WHAT_IF_PAIRS_SHOWN = 10


def changed(original: LoggedRun, settings: Sequence[str], faults: Given) -> Scenario:
    """The scenario of a log with `key=value` settings laid over it, and faults after its own.

    Raises:
        ScenarioError: that is not a possible scenario.

    """
    source = str(original.path)
    table = _without_none(msgspec.to_builtins(original.until_its_end()))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenario.toml"
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
        try:
            scenario = load_scenario(str(path), settings).scenario
        except ScenarioError as error:
            raise ScenarioError(str(error).replace(str(path), source)) from error
    return with_faults(scenario, fault_tables(faults, scenario.surveillance.broadcast_s), source)


def _without_none(value: Any) -> Any:
    """TOML has no value for nothing."""
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return [_without_none(v) for v in value] if isinstance(value, list | tuple) else value


def logged_outcome(original: LoggedRun) -> RunOutcome:
    """The outcome of a logged run, from its messages; what cannot be of it is left out."""
    participant_filter = ParticipantFilter(original.scenario)
    run_recorder = RunRecorder(original.scenario, None)
    moments = set[int]()
    for record in original.whole_records():
        if record.topic in SIMULATION_TOPICS:
            continue
        message = participant_filter.decode(record)
        if message is None:
            continue
        run_recorder.note((record.topic, record.payload, message), record.log_ns)
        if isinstance(message, Truth):
            moments.add(message.t_ns)
    run_recorder.finish()
    options = RunOptions(original.scenario, clock="realtime" if original.realtime else "lockstep")
    outcome = RunOutcome(options, run_recorder, original.about.status or "cut short")
    outcome.sim_s = max(moments, default=0) / 1e9
    outcome.ticks = len(moments)
    return outcome


def side_json(outcome: RunOutcome, digest: str) -> dict[str, Any]:
    """One side: what of a result can be compared, and the fault plan."""
    result = result_json(outcome) | {"digest": digest}
    plan = msgspec.to_builtins(outcome.plan)
    return {name: result[name] for name in FACTS_SHOWN} | {"fault_plan": plan}


def what_if_tables(
    log: dict[str, Any], what_if: dict[str, Any], outcomes: tuple[RunOutcome, RunOutcome]
) -> list[RenderableType]:
    """Both sides as a table of the nearest pairs and a table of facts; what differs stands out."""
    return [_pairs(outcomes), _facts(log, what_if, outcomes)]


def _pairs(outcomes: tuple[RunOutcome, RunOutcome]) -> Table:
    table = Table(title="Least separation of each pair, normalised", title_justify="left")
    for column in ("pair", "log", "what if"):
        table.add_column(column, justify="left" if column == "pair" else "right")
    sides = [{(m.a, m.b): m for m in o.run_recorder.separation.minima()} for o in outcomes]
    nearest = sorted(
        sides[0].keys() | sides[1].keys(),
        key=lambda pair: min(s[pair].least_separation for s in sides if pair in s),
    )
    for pair in nearest[:WHAT_IF_PAIRS_SHOWN]:
        table.add_row(f"{pair[0]}-{pair[1]}", *(_minimum(side.get(pair)) for side in sides))
    if len(nearest) > WHAT_IF_PAIRS_SHOWN:
        table.caption = f"the {WHAT_IF_PAIRS_SHOWN} nearest of {len(nearest)} pairs"
    return table


def _minimum(minimum: PairMinimum | None) -> str:
    if minimum is None:
        return "-"
    style = "bold red" if minimum.lost else "green"
    return f"[{style}]{separation_text(minimum.least_separation)}[/] at {minimum.t_s:.1f} s"


def _facts(
    log: dict[str, Any], what_if: dict[str, Any], outcomes: tuple[RunOutcome, RunOutcome]
) -> Table:
    table = Table(title="Results", title_justify="left")
    for column in ("", "log", "what if"):
        table.add_column(column, overflow="fold")
    rows = [_rows(side) for side in (log, what_if)]
    for row, outcome in zip(rows, outcomes, strict=True):
        row["faults"] = "\n".join(fault_lines(outcome.plan)) or "none"
    for name in {**rows[0], **rows[1]}:
        a, b = (escape(row.get(name, "-")) for row in rows)
        table.add_row(name, a, b if a == b else f"[bold]{b}[/]")
    return table


def _rows(side: dict[str, Any]) -> dict[str, str]:
    """The facts of one side, in words."""
    commands = side["commands"]
    latency = commands["latency_s"]
    rows = {
        "run": f"{side['status']}, {side['clock']}, {side['sim_s']:g} s, seed {side['seed']}",
        "digest": side["digest"] or "-",
        "lost separation": f"{side['pairs_lost']} of {counted(side['pairs'], 'pair')}",
        "all arrived": arrival_text(side, side["uavs"]),
        "of the UAVs": others_text(side["arrivals"]) or "-",
        "elections": str(side["elections"]),
        "commands": commands_words(commands),
        "issue to actuation": f"p50 {latency['p50']:.3g} s, p99 {latency['p99']:.3g} s"
        if latency
        else "-",
        "unresolved encounters": str(side["unresolved"]),
    }
    for kind, row in side["delivery"].items():
        dropped = "".join(f", {n} dropped by {fault}" for fault, n in row["dropped"].items())
        lost = f", {row['unreported']} not taken" if row["unreported"] else ""
        rows[f"delivery of {kind}"] = (
            f"{row['delivered']} of {row['sent']} delivered{dropped}{lost}"
        )
    return rows
