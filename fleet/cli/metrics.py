"""`fleet metrics` and `fleet compare`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from fleet.analysis.comparison import comparison
from fleet.analysis.metrics import (
    NMAC,
    ZONE,
    Incursions,
    LinkMetrics,
    RecordedRun,
    RunMetrics,
    Spread,
    Volume,
    measure,
)
from fleet.analysis.metrics.csv_files import write_csv
from fleet.analysis.words import arrival_text, counted, separation_text
from fleet.cli.compare import comparison_tables
from fleet.cli.screen import Screen

ROWS_SHOWN = 10


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("metrics")(metrics)
    app.command("compare")(compare)


VolumeOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--volume",
        metavar="NAME=H,V",
        help="A volume to look for incursions into, H m horizontally and V m vertically, in place "
        f"of {NMAC.name}={NMAC.horizontal_m:g},{NMAC.vertical_m:g}; can be repeated.",
    ),
]


def metrics(
    log: Annotated[Path, typer.Argument(help="An MCAP log written by 'fleet run'.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    csv_folder: Annotated[
        Path | None,
        typer.Option("--csv", metavar="DIR", help="Write tables as CSV files into this folder."),
    ] = None,
    volume: VolumeOptions = None,
    force: Annotated[bool, typer.Option(help="Overwrite CSV files that are there.")] = False,
) -> int:
    """Measure a run from its log: separation, alerts, commands, elections, deviation, delivery.

    What each number means is in docs/metrics.md.

    Example: fleet metrics four_way.mcap
    """
    run = measured(log, volumes_of(volume))
    if csv_folder is not None:
        write_csv(run, csv_folder, overwrite=force)
    if as_json:
        print(json.dumps({"log": str(log), **run.as_dict()}))
    else:
        Screen(highlight=False).print(*metric_tables(run), sep="\n")
    return 0


def compare(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="MCAP logs written by 'fleet run'.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    volume: VolumeOptions = None,
) -> int:
    """Put runs side by side: the settings in which they differ, then what came of it.

    Example: fleet compare calm.mcap lossy.mcap
    """
    volumes = volumes_of(volume)
    found = comparison([measured(log, volumes) for log in logs])
    names = [str(log) for log in logs]
    if as_json:
        print(json.dumps({"logs": names, **found}))
    else:
        console = Screen(highlight=False)
        console.print(*comparison_tables(titles(logs), found, console.width), sep="\n")
    return 0


def titles(logs: Sequence[Path]) -> list[str]:
    """The logs by their file names, where these are different."""
    short = [log.stem for log in logs]
    return short if len(set(short)) == len(logs) else [str(log) for log in logs]


def measured(log: Path, volumes: Sequence[Volume]) -> RunMetrics:
    """The metrics of a log, with a warning if it does not tell the whole run."""
    run = measure(RecordedRun.of_log(log), volumes)
    if not run.complete:
        print(
            f"fleet: {log}: the run was not completed, or its log is damaged; "
            f"measured up to {run.end_s:g} s",
            file=sys.stderr,
        )
    return run


def volumes_of(texts: Sequence[str] | None) -> tuple[Volume, ...]:
    """Volumes as given on the command line; raises BadParameter."""
    found = tuple(_volume(text) for text in texts or ())
    if any(volume.name == ZONE for volume in found):
        raise typer.BadParameter(
            f"'{ZONE}' is the name of the protected zones; take another", param_hint="--volume"
        )
    if len({volume.name for volume in found}) < len(found):
        raise typer.BadParameter("two volumes have the same name", param_hint="--volume")
    return found or (NMAC,)


def _volume(text: str) -> Volume:
    name, _, size = text.partition("=")
    try:
        horizontal_m, vertical_m = map(float, size.split(","))
    except ValueError:
        horizontal_m = vertical_m = 0.0
    fits = 0.0 < horizontal_m < 1e6 and 0.0 < vertical_m < 1e6
    if not (name.isidentifier() and fits):
        raise typer.BadParameter(
            f"'{text}' is no volume; write nmac=152.4,30.48", param_hint="--volume"
        )
    return Volume(name, horizontal_m, vertical_m)


def metric_tables(run: RunMetrics) -> list[RenderableType]:
    """What people read of it."""
    return [_pairs(run), _alerts(run), _uavs(run), _facts(run), _classes(run)]


def _pairs(run: RunMetrics) -> Table:
    names = [ZONE, *(volume.name for volume in run.volumes)]
    columns = ("pair", "normal.", "at s", "CPA m", "horiz.", "vert.", *map(escape, names))
    table = _table("Pairs, nearest first", *columns)
    for pair in run.pairs[:ROWS_SHOWN]:
        table.add_row(
            f"{pair.a}-{pair.b}",
            separation_text(pair.least_separation),
            f"{pair.t_s:.1f}",
            f"{pair.cpa_m:.1f}",
            f"{pair.horizontal_miss_m:.1f}",
            f"{pair.vertical_miss_m:.1f}",
            *(_held(held) for held in (pair.losses, *pair.volumes)),
        )
    return _captioned(table, len(run.pairs), "nearest pairs")


def _held(held: Incursions) -> str:
    if not held.count:
        return "[green]kept[/]"
    times = f"{held.count} x, " if held.count > 1 else ""
    return f"[bold red]{times}{held.duration_s:.1f} s, {held.severity:.0%}[/]"


def _alerts(run: RunMetrics) -> Table:
    columns = ("pair", "alert s", "to violation s", "lead s", "at risk s", "not led s")
    table = _table("Alerts, nearest pairs first", *columns)
    alerted = [pair for pair in run.pairs if pair.alerted_s is not None or pair.losses.count]
    for pair in alerted[:ROWS_SHOWN]:
        table.add_row(
            f"{pair.a}-{pair.b}",
            _number(pair.alerted_s, ".1f"),
            _number(pair.time_to_violation_s, ".1f"),
            _number(pair.alert_lead_s, ".1f"),
            f"{pair.at_risk_s:.1f}",
            f"{pair.without_computing_s:.1f}",
        )
    return _captioned(table, len(alerted), "alerts")


def _captioned(table: Table, count: int, of: str) -> Table:
    if count > ROWS_SHOWN:
        table.caption = f"the first {ROWS_SHOWN} of {count} {of}"
    return table


def _uavs(run: RunMetrics) -> Table:
    columns = ("arrived s", "delay s", "told s", "path m", "alt. m", "off s", "back s")
    table = _table("UAVs, farthest from plan first", "UAV", *columns)
    order = sorted(run.uavs, key=lambda u: -max(u.path_deviation_max_m, u.altitude_deviation_max_m))
    for uav in order[:ROWS_SHOWN]:
        table.add_row(
            str(uav.id),
            _number(uav.arrival_s, ".1f") if uav.arrived or uav.due else "not due",
            _number(uav.delay_s, ".1f"),
            f"{uav.commanded_s:.1f}",
            f"{uav.path_deviation_max_m:.1f}",
            f"{uav.altitude_deviation_max_m:.1f}",
            f"{uav.off_plan_s:.1f}",
            _number(uav.back_on_plan_s, ".1f") if uav.back_on_plan else "still off",
        )
    return _captioned(table, len(run.uavs), "UAVs")


def _facts(run: RunMetrics) -> Table:
    commands, elections, totals = run.commands, run.elections, run.totals
    table = Table(show_header=False)
    table.add_column()
    table.add_column(overflow="fold")
    lost = f"{totals.pairs_lost} of {counted(totals.pairs, 'pair')}"
    lost += f" ({counted(totals.losses, 'loss', 'losses')})" if totals.losses else ""
    table.add_row("lost separation", lost)
    table.add_row("all arrived", arrival_text(asdict(totals), len(run.uavs)))
    for name, count in totals.incursions.items():
        table.add_row(escape(name), str(count))
    alerts = f"{counted(totals.pairs_alerted, 'pair')}, missed {totals.missed_alerts}"
    table.add_row("alerts", alerts)
    table.add_row(
        "commands",
        f"{commands.issued} issued ({commands.transmissions} transmissions), {commands.applied} "
        f"applied, {commands.unanswered} unanswered",
    )
    refused = ", ".join(f"{reason} {n}" for reason, n in commands.refused_by_reason.items())
    table.add_row("refused", f"{commands.refused}" + (f" ({escape(refused)})" if refused else ""))
    table.add_row("issue to actuation", _spread(commands.latency_s))
    table.add_row("state age at decision", _spread(commands.state_age_s))
    table.add_row("unresolved encounters", str(commands.unresolved))
    table.add_row(
        "elections",
        f"{elections.terms}, {elections.by_uavs} by UAVs, {elections.changes} with another "
        "computing UAV",
    )
    table.add_row(
        "without computing UAV",
        f"{elections.without_computing_s:g} s of {elections.at_risk_s:g} s at risk, longest "
        f"{elections.longest_without_s:g} s",
    )
    return table


def _classes(run: RunMetrics) -> Table:
    columns = ("sent", "came", "settled", "ratio, 95 %", "plan", "mean s", "plan")
    table = _table("Delivery and latency, all links together", "class", *columns)
    for row in run.classes:
        table.add_row(
            row.kind,
            str(row.sent),
            str(row.delivered),
            str(row.settled),
            _ratio(row),
            _number(row.expected_ratio, ".3f"),
            _number(row.latency_s.mean, ".3f"),
            _number(row.expected_latency_s.mean, ".3f"),
        )
    table.caption = "plan: what the fault plan lets one expect"
    return table


def _ratio(row: LinkMetrics) -> str:
    if row.delivery_ratio is None:
        return "-"
    return f"{row.delivery_ratio:.3f}\n{row.delivery_low:.3f}-{row.delivery_high:.3f}"


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    for n, column in enumerate(columns):
        table.add_column(column, justify="right" if n else "left")
    return table


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _spread(spread: Spread) -> str:
    if not spread.count:
        return "-"
    told = {"mean": spread.mean, "p50": spread.p50, "p99": spread.p99, "max": spread.max}
    return ", ".join(f"{name} {_number(value, '.3f')} s" for name, value in told.items())
