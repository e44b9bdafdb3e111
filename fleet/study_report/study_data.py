"""A study as its report takes it: each cell with its summary, runs and place in the grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fleet.study.design import Cell
from fleet.study.results import ResultsFolder
from fleet.study.study_file import Factor, Study
from fleet.study.summary import CellSummary, by_cell, summaries
from fleet.study.zenoh_share import FlownAgain, flown_again

RUN_COLUMNS = (
    *("seed", "weight", "error", "lost", "nmac", "lost_without", "nmac_without"),
    *("least_separation", "least_without", "horizontal_m", "vertical_m", "least_s"),
    *("delay_max_s", "path_deviation_max_m"),
)
"""What is read of each run, beside its cell and number."""


@dataclass(frozen=True)
class ReportedFactor:
    """A factor: its levels in order, in words and as numbers (None where one has none).

    Where the design draws points there are no levels, and `labels` is empty.
    """

    name: str
    unit: str
    labels: tuple[str, ...]
    numbers: tuple[float, ...] | None

    @property
    def title(self) -> str:
        """Its name, with its unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


@dataclass(frozen=True)
class FailedRun:
    """A run that could not be flown."""

    cell: int
    run: int
    error: str


@dataclass(frozen=True)
class ReportedCell:
    """A cell: its number and levels in words, its summary, the columns of the runs that were flown.

    `at` is where it is in the grid, empty where points were drawn.
    """

    name: str
    summary: CellSummary
    flown: dict[str, Any]
    at: tuple[int, ...]

    @property
    def cell(self) -> Cell:
        """The combination of levels."""
        return self.summary.cell


@dataclass(frozen=True)
class StudyData:
    """All that a report of a study is made of. `said` is its folder as the user wrote it."""

    study: Study
    said: str
    factors: tuple[ReportedFactor, ...]
    cells: tuple[ReportedCell, ...]
    failed: tuple[FailedRun, ...]
    versions: dict[str, str]
    again: tuple[FlownAgain, ...]

    @property
    def grid(self) -> bool:
        """Whether all combinations of levels were flown, rather than points that were drawn."""
        return self.study.design.kind == "grid"

    @cached_property
    def flown_cells(self) -> list[ReportedCell]:
        """The cells of which a run was flown."""
        return [cell for cell in self.cells if cell.summary.runs]

    @cached_property
    def weighted(self) -> bool:
        """Whether some runs stand for more encounters than others."""
        weights = [cell.flown["weight"] for cell in self.flown_cells]
        return bool(weights) and min(w.min() for w in weights) < max(w.max() for w in weights)


def study_data_of(results: ResultsFolder, said: str) -> StudyData:
    """Read the results of a study.

    Raises:
        StudyError: they are damaged. MissingExtraError: scipy is not installed.

    """
    study, failed, flown = results.study, list[FailedRun](), list[dict[str, Any]]()
    for cell, rows in by_cell(results, results.table(RUN_COLUMNS)):
        errors = rows["error"]
        known = errors == ""
        flown.append({name: values[known] for name, values in rows.items()})
        for run, error in zip(rows["run"][~known], errors[~known], strict=True):
            failed.append(FailedRun(cell.number, int(run), str(error)))
    counts = [len(factor.values) or len(factor.level) for factor in study.factor]
    grid = study.design.kind == "grid"
    cells = tuple(
        ReportedCell(
            _name(summary.cell, study), summary, rows, _place(number, counts) if grid else ()
        )
        for number, (summary, rows) in enumerate(zip(summaries(results), flown, strict=True))
    )
    factors = tuple(_factor(factor, n, cells) for n, factor in enumerate(study.factor))
    again = tuple(flown_again(results.folder))
    return StudyData(study, said, factors, cells, tuple(failed), results.begun_with, again)


def _name(cell: Cell, study: Study) -> str:
    """As in `4: latency 0.5s, loss 30%`; numbers that were drawn with four digits."""
    words = [
        f"{level.factor} {level.number:.4g}{factor.unit}"
        if factor.drawn
        else f"{level.factor} {level.label}"
        for level, factor in zip(cell.levels, study.factor, strict=True)
    ]
    return f"{cell.number}: {', '.join(words)}" if words else "all runs"


def _place(number: int, counts: Sequence[int]) -> tuple[int, ...]:
    """The level of each factor in cell `number` of a grid; the last varies fastest."""
    return tuple(int(n) for n in np.unravel_index(number, counts)) if counts else ()


def _factor(factor: Factor, place: int, cells: Sequence[ReportedCell]) -> ReportedFactor:
    levels = {cell.at[place]: cell.cell.levels[place] for cell in cells if cell.at}
    labels = tuple(levels[n].label for n in sorted(levels))
    found = [levels[n].number for n in sorted(levels)]
    numbers = tuple(number for number in found if number is not None)
    return ReportedFactor(
        factor.name, factor.unit, labels, numbers if len(numbers) == len(found) else None
    )
