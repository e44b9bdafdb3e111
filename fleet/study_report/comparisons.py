"""Cells compared with one of them on the encounters that all of them flew."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from fleet.errors import StudyError
from fleet.model.types import Integers
from fleet.study.statistics.mcnemar import ConditionTest, compare_conditions
from fleet.study_report.study_data import ReportedCell, StudyData


@dataclass(frozen=True)
class CellComparisons:
    """Tests of each cell against one, by an event, on so many common encounters."""

    event: str
    against: ReportedCell
    encounters: int
    tests: tuple[tuple[ReportedCell, ConditionTest], ...]


def cell_comparisons(data: StudyData, event: str, against: int = 0) -> CellComparisons | None:
    """McNemar's test of each cell against cell `against`, with Holm's correction for all of them.

    None where there is nothing to compare: fewer than two cells with runs, no encounter that all
    flew, or points that were drawn, of which no one is what the others are to be held against.

    Raises:
        StudyError: there is no such cell, or it has no run that was flown.
        MissingExtraError: statsmodels is not installed.

    """
    if not 0 <= against < len(data.cells):
        raise StudyError(
            f"{data.said}: there is no cell {against}; they are 0 to {len(data.cells) - 1}"
        )
    cells = data.flown_cells
    if not data.grid or len(cells) < 2:
        return None
    reference = data.cells[against]
    if not reference.summary.runs:
        raise StudyError(f"{data.said}: no run of cell {against} was flown; name another")
    runs = common_runs(cells)
    if not len(runs):
        return None
    happened = {
        str(cell.cell.number): cell.flown[event][places_of_runs(cell, runs)].astype(np.bool_)
        for cell in cells
    }
    tests = compare_conditions(happened, str(against))
    by_number = {str(cell.cell.number): cell for cell in cells}
    found = tuple((by_number[test.second], test) for test in tests)
    return CellComparisons(event, reference, len(runs), found)


def common_runs(cells: list[ReportedCell]) -> Integers:
    """Numbers of the runs that were flown in all of these cells, rising."""
    numbers = [cell.flown["run"].astype(np.int64) for cell in cells]
    found: Integers = reduce(np.intersect1d, numbers)
    return found


def places_of_runs(cell: ReportedCell, runs: Integers) -> Integers:
    """Where these runs are among those of a cell that were flown."""
    return np.searchsorted(cell.flown["run"].astype(np.int64), runs)
