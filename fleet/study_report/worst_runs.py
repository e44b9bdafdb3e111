"""The runs in which UAVs came nearest, each with the commands that repeat it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass

import numpy as np

from fleet.study_report.study_data import ReportedCell, StudyData

MOST_WORST = 20


@dataclass(frozen=True)
class WorstRun:
    """A run and how near two UAVs came; see `RunRow` for what is what."""

    cell: ReportedCell
    run: int
    least_separation: float
    least_without: float
    horizontal_m: float
    vertical_m: float
    least_s: float
    lost: bool
    nmac: bool


def worst_runs(data: StudyData, most: int = MOST_WORST) -> list[WorstRun]:
    """The runs of least separation, nearest first; runs in which nobody met anybody are none."""
    found = []
    for cell in data.flown_cells:
        least = np.asarray(cell.flown["least_separation"], dtype=np.float64)
        order = np.argsort(least, kind="stable")[:most]
        found += [_run(cell, int(row)) for row in order if np.isfinite(least[row])]
    found.sort(key=lambda run: (run.least_separation, run.cell.cell.number, run.run))
    return found[:most]


def repeat_commands(data: StudyData, cell: int, run: int) -> list[str]:
    """Commands that fly a run again, as processes over zenoh, with log and report."""
    name = f"{data.study.name}-{cell}-{run}"
    return [
        f"fleet study scenario {shlex.quote(data.said)} {cell} {run} --out {name}.toml",
        f"fleet run {name}.toml --out {name}.mcap",
        f"fleet report {name}.mcap",
    ]


def _run(cell: ReportedCell, row: int) -> WorstRun:
    at = {name: values[row] for name, values in cell.flown.items()}
    return WorstRun(
        cell,
        int(at["run"]),
        float(at["least_separation"]),
        float(at["least_without"]),
        float(at["horizontal_m"]),
        float(at["vertical_m"]),
        float(at["least_s"]),
        bool(at["lost"]),
        bool(at["nmac"]),
    )
