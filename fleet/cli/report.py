"""`fleet report`."""

from __future__ import annotations

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from fleet.analysis.recorded_run import RecordCollector, RecordedRun
from fleet.cli.reading import opened_run
from fleet.cli.report_files import ReportFormat, check_free
from fleet.config.loading import read_scenario
from fleet.errors import LogError
from fleet.extras import import_extra
from fleet.log.new_files import keep, new_file
from fleet.log.run_metadata import run_metadata_of
from fleet.model.words import BusKind
from fleet.printing import printable
from fleet.report.run_data import RunData, run_data_of
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from fleet.simulation.simulation import RunOptions, run_metadata

PAPER = ("head_on", "side", "four_way")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report")(report)


def report(
    log: Annotated[Path | None, typer.Argument(help="An MCAP log written by 'fleet run'.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="The page; default the log's name with .html, beside it.")
    ] = None,
    png: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write figures for a paper there; the page only if --out is given."
        ),
    ] = None,
    paper: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="No log: fly the paper's encounters, and write its figures 3 to 10 there.",
        ),
    ] = None,
    formats: Annotated[
        list[ReportFormat] | None,
        typer.Option("--format", help="Of figures; can be given many times. Default png."),
    ] = None,
    dpi: Annotated[
        int, typer.Option(min=50, max=1200, help="Resolution of PNG figures, dots an inch.")
    ] = 300,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> int:
    """Draw a run: one HTML page that needs no network, or figures for a paper.

    \b
    Examples:
      fleet report four_way.mcap --open
      fleet report four_way.mcap --png figures --format png --format pdf
      fleet report --paper figures
    """  # noqa: D301 (the \b keeps the lines apart)
    suffixes = [f.value for f in formats or [ReportFormat.png]]
    if paper is not None:
        if log or out or png or open_:
            raise typer.BadParameter("--paper flies its own runs: drop LOG, --out, --png, --open")
        _paper(paper, suffixes, dpi, force)
        return 0
    if log is None:
        raise typer.BadParameter("name a log, or use --paper DIR")
    keep(log, out)
    page = out or (None if png and not open_ else log.with_suffix(".html"))
    if page is not None:
        check_free([page], force)
    run_data = run_data_of(opened_run(log))
    if run_data.damage:
        print(f"fleet: {log}: {printable(run_data.damage)}", file=sys.stderr)
    if page is not None:
        _write_page(run_data, log, page, force)
        print(page)
    if png is not None:
        _figures(run_data, png, suffixes, dpi, force, paper_only=False)
    if open_ and page is not None:
        webbrowser.open(page.resolve().as_uri())
    return 0


def _write_page(run_data: RunData, log: Path, page: Path, force: bool) -> None:
    from fleet.report.page import page_of  # noqa: PLC0415 (only when it is drawn)

    text = page_of(run_data, log.name)
    with new_file(page, overwrite=force) as part:
        part.write_text(text, encoding="utf-8")


def _figures(
    run_data: RunData, folder: Path, suffixes: list[str], dpi: int, force: bool, *, paper_only: bool
) -> None:
    """Write the figures of a run, all of them or those that the paper has."""
    import_extra("matplotlib", "report", "a figure")
    from fleet.report.paper import names_of, write_figures  # noqa: PLC0415 (an extra)

    names = names_of(run_data)
    if paper_only:
        names = {kind: name for kind, name in names.items() if name.startswith("figure_")}
    files = [folder / f"{name}.{suffix}" for name in names.values() for suffix in suffixes]
    check_free(files, force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for suffix in suffixes:
            write_figures(run_data, names, folder, suffix, dpi)
    except OSError as error:
        raise LogError(f"cannot write figures to {folder}: {error.strerror}") from error
    for file in sorted(files):
        print(file)


def _paper(folder: Path, suffixes: list[str], dpi: int, force: bool) -> None:
    """The paper's figures 3 to 10, from runs of its encounters."""
    check_free([folder / f"figure_{n:02d}.{s}" for n in range(3, 11) for s in suffixes], force)
    for name in PAPER:
        _figures(flown_in_memory(name), folder, suffixes, dpi, force, paper_only=True)


def flown_in_memory(name: str, overrides: tuple[str, ...] = ()) -> RunData:
    """The run of a scenario, flown in memory."""
    loaded = read_scenario(name, list(overrides))
    records = RecordCollector()
    run_recorder = RunRecorder(loaded.scenario, records)
    for _ in run_in_memory(loaded.scenario, run_recorder):
        pass
    options = RunOptions(loaded.scenario, loaded.text, loaded.overrides, bus=BusKind.MEMORY)
    result = {"status": "complete", "digest": run_recorder.digest}
    about = run_metadata_of(Path(name), {"run": run_metadata(options), "result": result})
    return run_data_of(RecordedRun(about, loaded.scenario.fault, records.kept))
