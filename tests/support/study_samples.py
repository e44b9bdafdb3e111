"""Results of studies that nobody flew: rows with outcomes that are known beforehand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from fleet.study.design import Cell
from fleet.study.loading import load_study
from fleet.study.results import ResultsFolder
from fleet.study.run_row import RunRow

LATENCY: dict[str, Any] = {"name": "latency", "fault": "latency", "unit": "s"}
LOSS: dict[str, Any] = {"name": "loss", "fault": "loss", "unit": "%"}
HORIZON: dict[str, Any] = {"name": "horizon", "key": "resolution.horizon_s"}
ELECTORS = {
    "name": "electors",
    "key": "coordination.electors",
    "values": ["coordinator", "local"],
}

LostOf = Callable[[Cell], int]
"""How many runs of a cell lose separation: the first ones."""


def row_of(cell: int, run: int, *, lost: bool, **more: Any) -> RunRow:
    """A run, which is near where it is lost; every second one would be lost without avoidance."""
    least = 0.5 + 0.001 * run if lost else 1.1 + 0.01 * run
    given: dict[str, Any] = {
        "seed": run,
        "digest": f"{cell}-{run}",
        "uavs": 2,
        "lost": lost,
        "nmac": lost and run == 0,
        "lost_without": run % 2 == 0,
        "nmac_without": run % 10 == 0,
        "least_separation": least,
        "least_without": 0.4 + 0.1 * run,
        "horizontal_m": 400.0 * least,
        "vertical_m": 3.0,
        "least_s": 40.0,
        "due": 2,
        "not_arrived": 0,
        "delay_max_s": 5.0 + run,
        "path_deviation_max_m": 100.0 + 10.0 * run,
        "commands": 2,
        "command_latency_s": 0.2,
    }
    return RunRow(cell=cell, run=run, **{**given, **more})


def study_table(runs: int = 40, **more: Any) -> dict[str, Any]:
    """A study of encounters of two."""
    return {"name": "made_up", "runs": runs, "encounters": {"kind": "pairs"}, **more}


def results_in(folder: Path, table: dict[str, Any], lost: LostOf, **more: Any) -> ResultsFolder:
    """Results of a study in which so many runs of each cell are lost."""
    results = ResultsFolder.create(folder, load_study(table))
    results.add(
        [
            row_of(cell.number, run, lost=run < lost(cell), **more)
            for cell in results.cells
            for run in range(results.study.runs)
        ]
    )
    return results
