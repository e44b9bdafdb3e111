"""`fleet metrics` and `fleet compare`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from fleet.analysis.comparison import comparison
from fleet.analysis.metrics import (
    NMAC,
    RunMetrics,
    Volume,
    measure,
)
from fleet.analysis.metrics.csv_files import write_csv
from fleet.analysis.metrics.values import ZONE
from fleet.cli.compare import comparison_tables
from fleet.cli.metric_tables import metric_tables
from fleet.cli.reading import opened_run
from fleet.cli.screen import Screen


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
        console = Screen(highlight=False)
        console.print(*metric_tables(run, console.width), sep="\n")
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
    run = measure(opened_run(log), volumes)
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
