"""`fleet study`: many runs over factors, and what they say."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Annotated

import tomli_w
import typer
from msgspec.structs import replace
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)

from fleet.analysis.words import counted
from fleet.cli.screen import Screen
from fleet.cli.study_extremes import add_extremes
from fleet.cli.study_report import add_report
from fleet.cli.study_table import study_tables
from fleet.config.loading import as_table
from fleet.errors import StudyError
from fleet.study.dask_engine import DaskCluster
from fleet.study.loading import base_scenario, load_study
from fleet.study.results import ResultsFolder, open_results, versions
from fleet.study.running import Engine, ProcessPool, StudyProgress, fly_missing
from fleet.study.scenario_of_run import scenario_of_run
from fleet.study.summary import alike_words, summaries
from fleet.study.zenoh_share import flown_again, fly_again

group = typer.Typer(
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Fly many runs over factors, and say what they show, with intervals.",
)

Results = Annotated[
    Path, typer.Argument(metavar="RESULTS", help="The folder of a study's results.")
]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    add_report(group)
    add_extremes(group)
    app.add_typer(group, name="study")


@group.command("run")
def fly_study(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The study, a TOML file.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results; default NAME.study here.")
    ] = None,
    runs: Annotated[
        int | None, typer.Option(min=1, help="Runs of each cell, instead of the file's.")
    ] = None,
    jobs: Annotated[
        int, typer.Option(min=0, help="Processes to fly in; 0: one for each processor.")
    ] = 0,
    dask: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="Fly on the Dask cluster with this scheduler instead."
        ),
    ] = "",
) -> int:
    """Fly a study, or what is missing of it: the same command goes on where it was left.

    Exit code 0: all runs were flown; 1: some could not be, each is a row with its error; 130:
    interrupted, and nothing that was flown is lost.

    \b
    Examples:
      fleet study run latency_loss.toml
      fleet study run latency_loss.toml --runs 1000 --jobs 2
      fleet study run latency_loss.toml --dask tcp://10.0.0.1:8786
    """  # noqa: D301 (the \b keeps the lines apart)
    study = load_study(file)
    if runs is not None:
        study = replace(study, runs=runs)
    folder = out or Path(f"{study.name}.study")
    results = ResultsFolder.create(folder, study)
    if results.begun_with != versions():
        print(
            f"fleet: {folder} was begun with other versions (see its versions.json)",
            file=sys.stderr,
        )
    try:
        engine: Engine = ProcessPool(jobs or os.cpu_count() or 1)
        engine = DaskCluster(dask) if dask else engine
        _fly_with_progress(results, engine)
    except KeyboardInterrupt:
        known = counted(len(results.known()), "run")
        print(
            f"fleet: interrupted; {folder} has {known}, the same command goes on", file=sys.stderr
        )
        return 130
    return _tell(results)


@group.command("show")
def show_study(results: Results) -> int:
    """Print what a study says so far: probabilities with their 95 % intervals, by cell.

    Exit code 0, or 1 if some of its runs could not be flown.
    """
    return _tell(open_results(results))


@group.command("scenario")
def write_scenario(
    results: Results,
    cell: Annotated[int, typer.Argument(min=0, metavar="CELL", help="Number of the cell.")],
    number: Annotated[int, typer.Argument(min=0, metavar="RUN", help="Number of the run in it.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The TOML file; default standard output.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
) -> int:
    """Write the scenario of one run of a study, to be flown again with processes, log and report.

    \b
    Example:
      fleet study scenario latency_loss.study 7 41 --out worst.toml
      fleet run worst.toml --out worst.mcap
    """  # noqa: D301 (the \b keeps the lines apart)
    found = open_results(results)
    if cell >= len(found.cells):
        raise StudyError(
            f"{results}: there is no cell {cell}; they are 0 to {len(found.cells) - 1}"
        )
    scenario = scenario_of_run(found.study, base_scenario(found.study), found.cells[cell], number)
    text = tomli_w.dumps(as_table(scenario))
    if out is None:
        print(text, end="")
        return 0
    if out.exists() and not force:
        raise StudyError(f"{out} exists already: name another with --out, or give --force")
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"{out}: cannot be written: {error.strerror}") from error
    return 0


def _fly_with_progress(results: ResultsFolder, engine: Engine) -> None:
    console = Screen(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    begun_s, begun_with = time.monotonic(), len(results.known())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task(results.study.name, total=None, rate="")

        def tell(done: StudyProgress) -> None:
            rate = (done.known - begun_with) / max(time.monotonic() - begun_s, 1e-9)
            shown = f"{rate:.1f} runs/s" if rate > 0.0 else ""
            progress.update(task, completed=done.known, total=done.total, rate=shown)

        def tell_again(done: int, total: int) -> None:
            progress.update(
                task, description="again over zenoh", completed=done, total=total, rate=""
            )

        fly_missing(results, engine, tell)
        fly_again(results, tell_again)


def _tell(results: ResultsFolder) -> int:
    """Print the tables of a study; 1 if some of its runs could not be flown."""
    found, screen = summaries(results), Screen()
    for table in study_tables(results.study, found, screen.width):
        screen.print(table)
    again = flown_again(results.folder)
    differing = [a for a in again if not a.agrees]
    if again:
        said = (
            f"{len(differing)} came to other digests" if differing else "all with the same digest"
        )
        print(f"{counted(len(again), 'run')} flown again over zenoh, {said}")
    alike = alike_words(found)
    if alike:
        print(f"fleet: {alike}", file=sys.stderr)
    failed = sum(cell.failed for cell in found)
    if failed:
        first = next(e for e in results.table(["error"])["error"].to_pylist() if e)
        print(
            f"fleet: {counted(failed, 'run')} could not be flown, the first: {first}",
            file=sys.stderr,
        )
    return 1 if failed or differing else 0
