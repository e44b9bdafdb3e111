"""`fleet study stress` and `fleet study search`: rare events, and the faults that make them."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import tomli_w
import typer
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from fleet.cli.screen import Screen
from fleet.config.loading import as_table
from fleet.config.scenario import Scenario
from fleet.errors import StudyError
from fleet.study.design import cells_of
from fleet.study.loading import load_study
from fleet.study.search import bounds_of, search
from fleet.study.statistics.subset import SubsetPlan
from fleet.study.stress import EXAMPLES, stress
from fleet.study.study_run import StudyEvent

File = Annotated[Path, typer.Argument(metavar="FILE", help="The study, a TOML file.")]
Jobs = Annotated[int, typer.Option(min=0, help="Processes to fly in; 0: one for each processor.")]
Out = Annotated[
    Path | None, typer.Option(help="Folder for the scenarios of examples; default none is written.")
]


Sought = Annotated[
    StudyEvent,
    typer.Option("--event", help="lost: loss of separation; nmac: near mid-air collision."),
]


def add_extremes(group: typer.Typer) -> None:
    """Add the commands."""
    group.command("stress")(stress_study)
    group.command("search")(search_study)


def stress_study(
    file: File,
    cell: Annotated[int, typer.Option(min=0, help="Number of the cell.")] = 0,
    event: Sought = "lost",
    points: Annotated[int, typer.Option(min=20, help="Runs of a subset, in each repeat.")] = 200,
    repeats: Annotated[int, typer.Option(min=2, help="Independent repeats.")] = 6,
    jobs: Jobs = 0,
    out: Out = None,
) -> int:
    """Estimate a small probability by subset simulation over all that is left to chance.

    \b
    Example:
      fleet study stress pairs.toml --cell 4 --event nmac --out worst
    """  # noqa: D301 (the \b keeps the lines apart)
    study = load_study(file)
    cells = cells_of(study)
    if cell >= len(cells):
        raise StudyError(f"{file}: there is no cell {cell}; they are 0 to {len(cells) - 1}")
    paths = _free(out, [f"{event}-{n}" for n in range(1, EXAMPLES + 1)])
    plan, processes = SubsetPlan(points=points, repeats=repeats), jobs or os.cpu_count() or 1
    with _counted() as tell:
        found = stress(study, cell, event, plan, jobs=processes, progress=tell)
    estimate = found.event.estimate
    print(
        f"{event} in cell {cell} ({cells[cell].text}): probability {estimate.value:.3g} "
        f"({estimate.low:.3g} to {estimate.high:.3g}, 95 %), of {estimate.runs} runs"
    )
    if not estimate.value:
        print("fleet: not reached in any repeat; give more --points", file=sys.stderr)
    _write(paths, [scenario for _, scenario in found.examples])
    return 0


def search_study(
    file: File,
    run: Annotated[int, typer.Option(min=0, help="Number of the encounter.")] = 0,
    event: Sought = "lost",
    generations: Annotated[int, typer.Option(min=1, help="Of the optimiser, at most.")] = 20,
    jobs: Jobs = 0,
    out: Out = None,
) -> int:
    """Seek the smallest faults with which one encounter comes to an event: an example.

    The factors of the study have low and high. Exit code 0: found; 1: the event did not happen at
    any point that was tried.

    \b
    Example:
      fleet study search faults.toml --run 3 --out found
    """  # noqa: D301 (the \b keeps the lines apart)
    study = load_study(file)
    bounds_of(study)
    paths = _free(out, [f"{event}-run-{run}"])
    with _counted() as tell:
        found = search(
            study,
            run,
            event,
            generations,
            jobs=jobs or os.cpu_count() or 1,
            progress=tell,
        )
    said = "the smallest that was found" if found.happens else "never; nearest"
    print(
        f"{event} in encounter {run}: {said} with {found.cell.text} (size {found.size:.3f}, "
        f"margin {found.margin:+.3f}), of {found.flown} runs"
    )
    _write(paths, [found.scenario])
    return 0 if found.happens else 1


@contextmanager
def _counted() -> Iterator[Callable[[int], None]]:
    """Shows how many runs were flown."""
    console = Screen(stderr=True)
    with Progress(
        TextColumn("{task.completed} runs flown"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task("", total=None)
        yield lambda flown: progress.update(task, completed=flown)


def _free(folder: Path | None, names: list[str]) -> list[Path]:
    """Where examples go, none if none are wanted: said before anything is flown for them."""
    paths = [folder / f"{name}.toml" for name in names] if folder else []
    for path in paths:
        if path.exists():
            raise StudyError(f"{path} exists already: name another --out")
    try:
        for path in paths[:1]:
            path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written: {error.strerror}") from error
    return paths


def _write(paths: list[Path], scenarios: list[Scenario]) -> None:
    """Write examples, and say how they are flown again."""
    for path, scenario in zip(paths, scenarios, strict=False):
        try:
            path.write_text(tomli_w.dumps(as_table(scenario)), encoding="utf-8")
        except OSError as error:
            raise StudyError(f"{path}: cannot be written: {error.strerror}") from error
        print(f"repeat: fleet run {path} --out {path.with_suffix('.mcap')}", file=sys.stderr)
