"""`fleet export` and `fleet view`."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from fleet.analysis.invariants import History
from fleet.export import rerun_view
from fleet.export.foxglove import write_foxglove
from fleet.export.lines import Line, lines_of
from fleet.export.output import fresh_file, fresh_folder
from fleet.export.rerun_file import write_rerun
from fleet.export.scene import Scene, messages_of, scene_of
from fleet.export.tables import Csv, Parquet, write_tables
from fleet.log.recorder import LogError

T = TypeVar("T")
Log = Annotated[Path, typer.Argument(help="An MCAP log written by 'fleet run'.")]


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("export")(export)
    app.command("view")(view)


def export(
    log: Log,
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
    print(_with_history(log, lambda history: chosen[0](history, log, out, force)))
    return 0


def view(
    log: Log,
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
    with tempfile.TemporaryDirectory(prefix="fleet-view-") as folder:
        recording = Path(folder) / f"{log.stem}.rrd"
        _with_history(log, lambda history: write_rerun(recording, *_scene(history)))
        if not web:
            return rerun_view.open_window(recording)
        with rerun_view.page(recording, port) as (address, server), suppress(KeyboardInterrupt):
            sys.stderr.write(f"{address} (Ctrl-C ends)\n")
            if browse:
                webbrowser.open(address)
            server.serve_forever()
    return 0


def _foxglove(history: History, log: Path, out: Path | None, force: bool) -> str:
    path = out or log.with_suffix(".foxglove.mcap")
    with fresh_file(path, overwrite=force) as part, part.open("wb") as file:
        count = write_foxglove(file, path, *_scene(history))
    return f"{path}: {count} messages"


def _rerun(history: History, log: Path, out: Path | None, force: bool) -> str:
    path = out or log.with_suffix(".rrd")
    with fresh_file(path, overwrite=force) as part:
        write_rerun(part, *_scene(history))
    return f"{path}: open it with 'rerun {path}'"


def _csv(history: History, log: Path, out: Path | None, force: bool) -> str:
    return _tables(history, out or log.with_name(f"{log.stem}_csv"), force, Csv)


def _parquet(history: History, log: Path, out: Path | None, force: bool) -> str:
    return _tables(history, out or log.with_name(f"{log.stem}_parquet"), force, Parquet)


def _tables(history: History, path: Path, force: bool, kind: type[Csv] | type[Parquet]) -> str:
    with fresh_folder(path, overwrite=force) as part:
        rows = write_tables(part, history.records, kind)
    return f"{path}: {len(rows)} tables, {sum(rows.values())} rows"


def _scene(history: History) -> tuple[Scene, list[Line]]:
    messages = list(messages_of(history))
    scene = scene_of(history.scenario, messages)
    return scene, lines_of(messages, history.plan, scene)


def _with_history(log: Path, use: Callable[[History], T]) -> T:
    """What comes of a log; raises LogError if it, or a message in it, cannot be read."""
    history = History.of_log(log)
    try:
        return use(history)
    except ValueError as error:
        raise LogError(f"{log}: a message is not understood ({error})") from error
