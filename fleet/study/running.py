"""A study from its beginning, or from where it was left, to its end."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import msgspec

from fleet.arguments import path_of, require, require_callable
from fleet.errors import FailedError
from fleet.simulation.worker_pool import WorkerPool
from fleet.study.batches import BatchOrder, batch_size, batches_of, fly_batch
from fleet.study.design import Cell
from fleet.study.loading import base_scenario, load_study
from fleet.study.results import ResultsFolder
from fleet.study.run_row import RunRow
from fleet.study.statistics.stopping import StoppingRule
from fleet.study.study_file import Study
from fleet.study.zenoh_share import fly_again

BATCHES_AHEAD = 2


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is: runs that are known, and how many there will be at most.

    `cells_open` is how many cells need more runs; `failed` counts the runs of this command that
    could not be flown.
    """

    known: int
    total: int
    cells_open: int
    failed: int


class Engine(Protocol):
    """What flies batches: processes of this machine, or of many."""

    def fly(self, orders: Iterator[BatchOrder]) -> Iterator[tuple[BatchOrder, list[RunRow]]]:
        """Each with its rows, in any order; raises FailedError if it cannot go on."""
        ...


@dataclass(frozen=True)
class ProcessPool:
    """The processors of this machine: an engine; one job is flown in this process."""

    jobs: int

    def fly(self, orders: Iterator[BatchOrder]) -> Iterator[tuple[BatchOrder, list[RunRow]]]:
        """Each with its rows, as they are done."""
        try:
            with WorkerPool(self.jobs) as pool:
                yield from pool.each(fly_batch, orders, BATCHES_AHEAD)
        except BrokenProcessPool as error:
            raise FailedError(
                "a worker process was killed (is there memory enough?): what was flown is kept; "
                "run the same command again to go on"
            ) from error


def run_study(
    study: str | PathLike[str] | Mapping[str, Any] | Study,
    out: str | PathLike[str] | None = None,
    *,
    jobs: int = 0,
    progress: Callable[[StudyProgress], None] | None = None,
) -> ResultsFolder:
    """Fly a study, or what is missing of it, in processes of this machine.

    `study` is what `load_study` takes, `out` the folder of its results (NAME.study), `jobs` the
    number of processes, 0 for one each processor; `progress` is called after each batch.

    Raises:
        StudyError: the study cannot be flown, or `out` has something else in it.
        FailedError: a worker was killed, or results cannot be written; `run_study` goes on.
        FleetStoppedError: a run that was flown again over zenoh became invalid.
        KeyboardInterrupt: it was interrupted; the batches that were done are kept.

    """
    require(jobs, int, "jobs", "a number of processes")
    require_callable(progress, "progress", "a function")
    loaded = load_study(study)
    folder = Path(f"{loaded.name}.study") if out is None else path_of(out, "out", "a folder")
    results = ResultsFolder.create(folder, loaded)
    fly_missing(results, ProcessPool(jobs or os.cpu_count() or 1), progress or (lambda _: None))
    fly_again(results)
    return results


def fly_missing(
    results: ResultsFolder,
    engine: Engine,
    progress: Callable[[StudyProgress], None] = lambda _: None,
) -> None:
    """Fly what is missing of a study, and put all rows into one file.

    Raises:
        StudyError: another command flies it.
        FailedError: the engine cannot go on, or the results cannot be written.
        KeyboardInterrupt: it was interrupted; the batches that were done are kept.

    """
    with results.alone():
        _fly_missing(results, engine, progress)


def _fly_missing(
    results: ResultsFolder, engine: Engine, progress: Callable[[StudyProgress], None]
) -> None:
    study = results.study
    base, text = base_scenario(study), msgspec.json.encode(study)
    size = batch_size(study, base, results.cells[0])
    known, failed = results.known(), 0
    total = study.runs * len(results.cells)
    open_cells: list[Cell] = list(results.cells)
    for first, end in _blocks(study):
        missing = list(batches_of(open_cells, range(first, end), known, size))
        progress(StudyProgress(len(known), total, len(open_cells), failed))
        for order, rows in engine.fly(BatchOrder(text, batch) for batch in missing):
            results.add(rows)
            known.update(order.batch.each())
            failed += sum(1 for row in rows if row.error)
            progress(StudyProgress(len(known), total, len(open_cells), failed))
        if study.stop is not None:
            before = len(open_cells)
            open_cells = _needing_more(study, results, open_cells, end)
            total -= (before - len(open_cells)) * (study.runs - end)
    progress(StudyProgress(len(known), total, 0, failed))
    results.close()


def _needing_more(
    study: Study, results: ResultsFolder, cells: Sequence[Cell], end: int
) -> list[Cell]:
    """The cells in which the event is not known well enough by the runs before `end`.

    Later runs, of a study that was left and goes on, do not count: it stops where it would have.
    What could not be flown is left out, so that a cell of nothing else is flown to its end.
    """
    stop = study.stop
    assert stop is not None
    rule = StoppingRule(stop.half_width, study.runs, stop.level)
    table = results.table(["cell", stop.event])
    columns = (table[name].to_pylist() for name in ("cell", "run", stop.event))
    happened: dict[int, list[bool]] = {cell.number: [] for cell in cells}
    for cell, run, event in zip(*columns, strict=True):
        if event is not None and cell in happened and run < end:
            happened[cell].append(event)
    return [c for c in cells if not rule.enough(sum(happened[c.number]), len(happened[c.number]))]


def _blocks(study: Study) -> Iterator[tuple[int, int]]:
    """The first run of each block and the first after it: up to a look, or all together."""
    size = study.stop.look_every if study.stop else study.runs
    for first in range(0, study.runs, size):
        yield first, min(first + size, study.runs)
