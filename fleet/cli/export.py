"""`fleet export` and `fleet view`."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

import fleet.log
from fleet.cli.reading import opened_run
from fleet.export import rerun_view
from fleet.export.foreign_tables import write_foreign_tables
from fleet.export.foxglove import write_foxglove
from fleet.export.lines import Line, lines_of
from fleet.export.rerun_file import write_rerun
from fleet.export.scene import Scene, scene_of
from fleet.export.tables import Csv, Parquet, write_tables
from fleet.log.new_files import keep, new_file, new_folder
from fleet.model.units import to_s
from fleet.printing import printable

LEFT_OUT_SHOWN = 5

LogArgument = Annotated[Path, typer.Argument(help="An MCAP log written by 'fleet run'.")]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("export")(export)
    app.command("view")(view)


def export(
    log: LogArgument,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="An MCAP for Foxglove and Lichtblick.")
    ] = False,
    rerun: Annotated[
        bool, typer.Option("--rerun", help="A recording for rerun (needs the extra 'rerun').")
    ] = False,
    csv: Annotated[
        bool, typer.Option("--csv", help="A directory with a CSV file for each message class.")
    ] = False,
    parquet: Annotated[
        bool, typer.Option("--parquet", help="The same as Parquet (needs the extra 'parquet').")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="File or directory; default: beside the log, named after it."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite what is there.")] = False,
) -> int:
    """Write a log in a form that other programs read. The log itself stays as it is.

    Example: fleet export four_way.mcap --foxglove
    """
    chosen = [
        how
        for given, how in (
            (foxglove, _foxglove),
            (rerun, _rerun),
            (csv, _csv),
            (parquet, _parquet),
        )
        if given
    ]
    if len(chosen) != 1:
        raise typer.BadParameter("choose one of --foxglove, --rerun, --csv and --parquet")
    keep(log, out)
    print(chosen[0](log, out, force))
    return 0


def view(
    log: LogArgument,
    web: Annotated[
        bool, typer.Option("--web", help="In a browser, served to this machine alone.")
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of --web; 0 takes a free one.")
    ] = 0,
    browse: Annotated[
        bool,
        typer.Option("--open/--no-open", help="With --web: open the browser, or only say where."),
    ] = True,
) -> int:
    """Show a log in rerun: 3-D scene, separation, commands, log lines (needs the extra 'rerun').

    Example: fleet view four_way.mcap
    """
    if not web and not rerun_view.has_display():
        raise typer.BadParameter("there is no display here; use --web")
    with tempfile.TemporaryDirectory(prefix="fleet-view-") as folder:
        recording = Path(folder) / f"{log.stem}.rrd"
        write_rerun(recording, *_scene(log))
        if not web:
            return rerun_view.open_window(recording)
        with rerun_view.page(recording, port) as (address, server), suppress(KeyboardInterrupt):
            sys.stderr.write(f"{address} (Ctrl-C ends)\n")
            if browse:
                webbrowser.open(address)
            server.serve_forever()
    return 0


def _foxglove(log: Path, out: Path | None, force: bool) -> str:
    path = out or log.with_suffix(".foxglove.mcap")
    shown = _scene(log)
    with new_file(path, overwrite=force) as part, part.open("wb") as file:
        count = write_foxglove(file, *shown)
    return f"{path}: {count} messages"


def _rerun(log: Path, out: Path | None, force: bool) -> str:
    path = out or log.with_suffix(".rrd")
    shown = _scene(log)
    with new_file(path, overwrite=force) as part:
        write_rerun(part, *shown)
    return f"{path}: open it with 'rerun {path}'"


def _csv(log: Path, out: Path | None, force: bool) -> str:
    return _tables(log, out or log.with_name(f"{log.stem}_csv"), force, Csv)


def _parquet(log: Path, out: Path | None, force: bool) -> str:
    return _tables(log, out or log.with_name(f"{log.stem}_parquet"), force, Parquet)


def _tables(log: Path, path: Path, force: bool, kind: type[Csv] | type[Parquet]) -> str:
    opened = fleet.log.open(log, _warn)
    with new_folder(path, overwrite=force) as part:
        rows = write_tables(part, opened.messages(), kind)
        foreign = write_foreign_tables(part, opened, kind)
    if foreign.left_out:
        told = "; ".join(foreign.left_out[:LEFT_OUT_SHOWN])
        more = "; ..." if len(foreign.left_out) > LEFT_OUT_SHOWN else ""
        _warn(f"{log}: left out of foreign messages: {printable(told)}{more}")
    rows |= foreign.rows
    return f"{path}: {len(rows)} tables, {sum(rows.values())} rows"


def _scene(log: Path) -> tuple[Scene, list[Line]]:
    """What viewers show of a log; raises LogError if it cannot be read."""
    run = opened_run(log)
    messages = list(run.messages())
    scene = scene_of(run.scenario, messages)
    if not run.complete:
        end_s = to_s(scene.end_ns)
        _warn(f"{log}: the run was not completed, or its log is damaged; shown up to {end_s:g} s")
    return scene, lines_of(messages, run.plan, scene)


def _warn(warning: str) -> None:
    sys.stderr.write(f"fleet: warning: {warning}\n")
