"""How many runs keep at least so much: the survival curve of an outcome, with a band."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.model.types import Array, Integers
from fleet.study.statistics.estimate import LEVEL, error_share, numbers_of, scipy_stats

BandKind = Literal["simultaneous", "pointwise"]
"""`simultaneous`: the whole curve is in the band (the exact form of that of Dvoretzky, Kiefer and
Wolfowitz); `pointwise`: each point is, but not all at once (Clopper-Pearson)."""


@dataclass(frozen=True, slots=True, eq=False)
class SurvivalCurve:
    """The probability that an outcome is at least `at`, with a band; arrays of one shape.

    Between two points the curve is that of the next one above: it falls just after each value.
    """

    at: Array
    """Values of the outcome, rising, in its unit."""
    share: Array
    low: Array
    high: Array
    level: float
    runs: int
    method: str


def survival_of(
    values: ArrayLike,
    at: ArrayLike | None = None,
    level: float = LEVEL,
    band: BandKind = "simultaneous",
) -> SurvivalCurve:
    """The survival curve of an outcome with one value a run, such as the least separation.

    It is told at `at`, or at every value that occurred. Values may be infinite (a run in which no
    two UAVs were in the air).

    Sources: the distribution of Kolmogorov's statistic for so many runs (R. Simard and P. L'Ecuyer,
    Journal of Statistical Software 39 (2011)); P. Massart, Annals of Probability 18 (1990), for the
    inequality.

    Raises:
        ArgumentError: no values, a nan among them, or an unknown band.
        MissingExtraError: SciPy is not installed.
    """
    given = np.sort(numbers_of("values", values, finite=False))
    points = np.unique(given if at is None else numbers_of("at", at, finite=False))
    counts = len(given) - np.searchsorted(given, points, side="left")
    share = counts / len(given)
    if band == "simultaneous":
        low, high = _simultaneous(share, len(given), level)
    elif band == "pointwise":
        low, high = _pointwise(counts, len(given), level)
    else:
        raise ArgumentError(f"band: expected simultaneous or pointwise, not {band!r}")
    return SurvivalCurve(points, share, low, high, level, len(given), band)


def _simultaneous(share: Array, runs: int, level: float) -> tuple[Array, Array]:
    reach = _kolmogorov(level, runs)
    return np.maximum(share - reach, 0.0), np.minimum(share + reach, 1.0)


@lru_cache(maxsize=1024)
def _kolmogorov(level: float, runs: int) -> float:
    """How far the shares of so many runs are from the truth at most, at that level."""
    return float(scipy_stats().kstwo.isf(error_share(level), runs))


def _pointwise(counts: Integers, runs: int, level: float) -> tuple[Array, Array]:
    beta, missed = scipy_stats().beta, error_share(level) / 2
    none, every = counts == 0, counts == runs
    low = beta.ppf(missed, np.where(none, 1, counts), runs - counts + 1)
    high = beta.isf(missed, counts + 1, np.where(every, 1, runs - counts))
    return np.where(none, 0.0, low), np.where(every, 1.0, high)
