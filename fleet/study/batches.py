"""The work of a study in batches: what is handed to a worker, and what comes back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import msgspec
from msgspec import Struct

from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.errors import ScenarioError
from fleet.study.design import Cell, cells_of
from fleet.study.encounters.encounter_kind import fault_seed
from fleet.study.loading import base_scenario
from fleet.study.run_row import RunRow
from fleet.study.scenario_of_run import cell_scenario, drawn_encounter, scenario_of_run
from fleet.study.study_file import Study
from fleet.study.study_run import study_run

BATCH_UAV_SECONDS, MOST_RUNS = 2_400.0, 64
"""A batch is of so much flying, and of so many runs at most."""

StudyRuns = set[tuple[int, int]]
"""Runs by cell and number."""


class Batch(Struct, frozen=True):
    """Runs that are flown together: numbers, each with the cells in which it is flown."""

    runs: tuple[tuple[int, tuple[int, ...]], ...]

    def each(self) -> list[tuple[int, int]]:
        """Cell and number of each run."""
        return [(cell, run) for run, cells in self.runs for cell in cells]


class BatchOrder(Struct, frozen=True):
    """A batch and its study, as JSON, since that is what goes to other processes and hosts."""

    study: bytes
    batch: Batch


def batches_of(
    cells: Sequence[Cell], numbers: range, known: StudyRuns, batch_runs: int
) -> Iterator[Batch]:
    """The runs with these numbers in these cells that are not known, in batches of so many.

    An encounter is flown in all cells before the next, so that what is known of a study that is
    not complete compares the same encounters.
    """
    runs, size = list[tuple[int, tuple[int, ...]]](), 0
    for number in numbers:
        left = [cell.number for cell in cells if (cell.number, number) not in known]
        while left:
            some, left = left[: batch_runs - size], left[batch_runs - size :]
            runs.append((number, tuple(some)))
            size += len(some)
            if size == batch_runs:
                yield Batch(tuple(runs))
                runs, size = [], 0
    if runs:
        yield Batch(tuple(runs))


def batch_size(study: Study, base: Scenario, cell: Cell) -> int:
    """Of how many runs a batch is, by how much is flown in the first."""
    first = scenario_of_run(study, base, cell, 0)
    flown = first.duration_s * len(uavs_of(first))
    return max(1, min(MOST_RUNS, int(BATCH_UAV_SECONDS / flown)))


def fly_batch(order: BatchOrder) -> list[RunRow]:
    """Fly the runs of a batch; what goes wrong in one is in its row."""
    study, base, cells = _parts(order.study)
    rows = []
    for run, numbers in order.batch.runs:
        try:
            drawn = drawn_encounter(study, base, run)
        except ScenarioError as error:
            seed = fault_seed(study.seed, run)
            rows += [RunRow(cell=cell, run=run, seed=seed, error=str(error)) for cell in numbers]
            continue
        for number in numbers:
            cell, scenario = cells[number]
            rows.append(study_run(study, cell, scenario, run, drawn))
    return rows


@lru_cache(maxsize=4)
def _parts(text: bytes) -> tuple[Study, Scenario, list[tuple[Cell, Scenario]]]:
    """The study of a text, its base scenario, and its cells with their scenarios."""
    study = msgspec.json.decode(text, type=Study)
    base = base_scenario(study)
    return study, base, [(cell, cell_scenario(base, cell)) for cell in cells_of(study)]
