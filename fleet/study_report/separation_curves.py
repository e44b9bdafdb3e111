"""Survival of the least separation: how many runs keep at least so much, cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fleet.model.types import Array
from fleet.report.plot import Json, packed
from fleet.study.statistics.estimate import LEVEL
from fleet.study.statistics.survival import survival_of
from fleet.study.statistics.weights import weighted_proportion
from fleet.study_report.study_data import ReportedCell, StudyData

MOST_POINTS, MOST_WEIGHTED_POINTS = 240, 60
"""Points of a curve; a weighted one has a band point by point, which takes longer."""
MOST_CURVES, SOME_CURVES = 600, 5
"""A grid of more cells, and points that were drawn, show a few of their cells alone."""
LEAST_END, MOST_END = 2.0, 8.0
"""Curves are drawn to a normalised separation between these."""


@dataclass(frozen=True)
class SeparationCurve:
    """The share of runs that keep at least `at`, with a band."""

    at: Array
    share: Array
    low: Array
    high: Array

    def packed(self) -> Json:
        """For the script."""
        columns = {"at": self.at, "share": self.share, "low": self.low, "high": self.high}
        return {name: packed(values) for name, values in columns.items()}


@dataclass(frozen=True)
class SeparationCurves:
    """Curves by cell, and those without avoidance: of one cell alone if they are all the same.

    `chosen` are the cells to be drawn together where they make no grid, or are too many; `end` is
    the separation to which they are worth drawing; `band` says what the band is.
    """

    by_cell: dict[int, SeparationCurve]
    without: dict[int, SeparationCurve]
    same_without: bool
    chosen: tuple[int, ...]
    end: float
    band: str


def separation_curves(data: StudyData) -> SeparationCurves:
    """The curves of a study; raises MissingExtraError without SciPy."""
    cells = data.flown_cells
    chosen: tuple[int, ...] = ()
    if not data.grid or len(cells) > MOST_CURVES:
        cells = some_cells(cells)
        chosen = tuple(cell.cell.number for cell in cells)
    values = [_nearest(cell, "least_separation") for cell in cells]
    without = [_nearest(cell, "least_without") for cell in cells]
    end = _end([*values, *without])
    weights = [cell.flown["weight"] if data.weighted else None for cell in cells]
    same = len({found.tobytes() for found in without}) == 1
    numbers = [cell.cell.number for cell in cells]
    curves = [_curve(v, w, end) for v, w in zip(values, weights, strict=True)]
    shown = 1 if same else len(cells)
    beside = [_curve(v, w, end) for v, w in zip(without[:shown], weights, strict=False)]
    return SeparationCurves(
        dict(zip(numbers, curves, strict=True)),
        dict(zip(numbers, beside, strict=False)),
        same,
        chosen,
        end,
        "pointwise" if data.weighted else "simultaneous",
    )


def some_cells(cells: Sequence[ReportedCell]) -> list[ReportedCell]:
    """A few cells from the safest to the worst, by probability of a loss of separation."""
    rising = sorted(cells, key=lambda cell: cell.summary.events["lost"].probability.value)
    if len(rising) <= SOME_CURVES:
        return rising
    return [rising[n] for n in np.linspace(0, len(rising) - 1, SOME_CURVES).astype(int)]


def _nearest(cell: ReportedCell, column: str) -> Array:
    """The least separation of each run: infinite if no two UAVs were ever in the air."""
    values = np.asarray(cell.flown[column], dtype=np.float64)
    return np.where(np.isnan(values), np.inf, values)


def _end(samples: Sequence[Array]) -> float:
    finite = [np.quantile(v[np.isfinite(v)], 0.9) for v in samples if np.isfinite(v).any()]
    return float(np.clip(max(finite, default=LEAST_END), LEAST_END, MOST_END))


def _curve(values: Array, weights: Array | None, end: float) -> SeparationCurve:
    """A curve at every value that occurred, or at as many as can be seen; always at 0 and at 1."""
    most = MOST_POINTS if weights is None else MOST_WEIGHTED_POINTS
    seen = np.unique(values[values < end])
    if len(seen) > most:
        seen = seen[np.linspace(0, len(seen) - 1, most).astype(int)]
    at = np.unique([0.0, *seen, 1.0, end])
    if weights is None:
        found = survival_of(values, at, LEVEL)
        return SeparationCurve(found.at, found.share, found.low, found.high)
    shares = [weighted_proportion(values >= x, weights, LEVEL).estimate for x in at]
    low, high = (np.array([getattr(s, n) for s in shares]) for n in ("low", "high"))
    return SeparationCurve(at, np.array([s.value for s in shares]), low, high)
