"""How much of what cells differ by is due to each factor: Sobol indices, or main effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fleet.analysis.words import counted
from fleet.model.types import Array
from fleet.study.statistics.estimate import LEVEL, Estimate
from fleet.study.statistics.main_effects import GRID_RESAMPLES, main_effects
from fleet.study.statistics.sensitivity import sobol_shares
from fleet.study_report.comparisons import common_runs, places_of_runs
from fleet.study_report.study_data import StudyData

ANALYSED = {
    "lost": "loss of separation",
    "nmac": "NMAC",
    "least_separation": "least separation",
    "delay_max_s": "greatest delay",
    "path_deviation_max_m": "greatest path deviation",
}
"""Outcomes of runs by column, and in words."""
TOGETHER = "factors together"
MOST_NUMBERS, LEAST_RESAMPLES = 200_000_000, 200
"""Grids of many runs are drawn again less often."""


@dataclass(frozen=True)
class OutcomeShares:
    """Shares of the variance of an outcome: by each factor alone, and what else there is.

    Of a grid the last of `first` is what factors do together, and `total` is empty; of a Saltelli
    design `total` has each factor alone and together with others.
    """

    outcome: str
    first: dict[str, Estimate]
    total: dict[str, Estimate]


@dataclass(frozen=True)
class FactorShares:
    """What is known of a study's factors; where nothing is, `why` says why."""

    kind: str
    shares: tuple[OutcomeShares, ...]
    why: str


def factor_shares(data: StudyData) -> FactorShares:
    """Sobol indices where the design is Saltelli's, main effects where it is a grid."""
    if not data.factors:
        return FactorShares("", (), "The study has no factors.")
    if data.weighted:
        return FactorShares("", (), "Not computed: the encounters have weights.")
    if data.study.design.kind == "saltelli":
        return _sobol(data)
    if not data.grid:
        return FactorShares(
            "", (), "Needs a grid, or the design saltelli; points of other designs do not tell."
        )
    return _main_effects(data)


def _sobol(data: StudyData) -> FactorShares:
    missing = len(data.cells) - len(data.flown_cells)
    if missing:
        return FactorShares("", (), _unflown(missing))
    names = [factor.name for factor in data.factors]
    found = []
    for column, words in ANALYSED.items():
        means = [_mean(cell.flown[column]) for cell in data.cells]
        if np.isfinite(means).all() and np.ptp(means) > 0.0:
            shares = sobol_shares(names, means, data.study.seed, LEVEL)
            first = {share.factor: share.first for share in shares}
            found.append(OutcomeShares(words, first, {s.factor: s.total for s in shares}))
    return FactorShares("sobol", tuple(found), "" if found else NOTHING)


NOTHING = "Cells do not differ in any outcome."


def _unflown(missing: int) -> str:
    return f"Not computed: no run was flown of {counted(missing, 'cell')}."


def _main_effects(data: StudyData) -> FactorShares:
    shape = [len(factor.labels) for factor in data.factors]
    varied = [n for n, count in enumerate(shape) if count > 1]
    if len(varied) < 2:
        why = "No factor has two levels."
        if varied:
            why = f"All that cells differ by is due to {data.factors[varied[0]].name}."
        return FactorShares("", (), why)
    missing = len(data.cells) - len(data.flown_cells)
    if missing:
        return FactorShares("", (), _unflown(missing))
    runs = common_runs(data.flown_cells)
    if len(runs) < 2:
        return FactorShares("", (), "Needs two runs that were flown in all cells.")
    names = [data.factors[n].name for n in varied]
    rows = [places_of_runs(cell, runs) for cell in data.cells]
    found = []
    for column, words in ANALYSED.items():
        values = np.array(
            [_numbers(c.flown[column])[r] for c, r in zip(data.cells, rows, strict=True)]
        )
        values = values[:, np.isfinite(values).all(axis=0)]
        shares = _shares_of_grid(names, values, [shape[n] for n in varied], data.study.seed)
        if shares is not None:
            found.append(OutcomeShares(words, shares, {}))
    return FactorShares("grid", tuple(found), "" if found else NOTHING)


def _shares_of_grid(
    names: Sequence[str], values: Array, shape: Sequence[int], seed: int
) -> dict[str, Estimate] | None:
    """Main effects of outcomes (cells, runs); None if the cells do not differ."""
    runs = values.shape[1]
    if runs < 2 or np.ptp(values.mean(axis=1)) == 0.0:
        return None
    resamples = min(GRID_RESAMPLES, max(LEAST_RESAMPLES, MOST_NUMBERS // values.size))
    found = main_effects(names, values.reshape(*shape, runs), seed, LEVEL, resamples)
    if not all(np.isfinite(share.value) for share in found.factors.values()):
        return None
    return {**found.factors, TOGETHER: found.interactions}


def _numbers(column: Array) -> Array:
    return np.asarray(column, dtype=np.float64)


def _mean(column: Array) -> float:
    numbers = _numbers(column)
    numbers = numbers[np.isfinite(numbers)]
    return float(numbers.mean()) if len(numbers) else float("nan")
