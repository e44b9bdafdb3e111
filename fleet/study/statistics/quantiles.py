"""Means and quantiles of an outcome, with intervals that take whole runs as the unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.model.types import Array, Indices
from fleet.study.statistics.estimate import (
    LEVEL,
    Estimate,
    error_share,
    numbers_of,
    scipy_stats,
    share_of,
)

RESAMPLES = 2000
"""How many times the runs are drawn again."""
BATCH_NUMBERS = 4_000_000
"""About how many numbers are in memory at once while runs are drawn again."""

OfTimes = Callable[[Array], Array]
"""A statistic of how many times each run was drawn: (resamples, runs) to (resamples,)."""


def quantile_by_order(values: ArrayLike, share: float, level: float = LEVEL) -> Estimate:
    """The quantile of an outcome that has one value a run, between two order statistics.

    Exact for any distribution of independent runs: never covers less than its level. A bound is
    infinite where the runs are too few for one. Values may be infinite. The value is the smallest
    with at least `share` of the runs at or below it.

    Source: W. J. Conover, Practical Nonparametric Statistics (1999), 3.2.

    Raises:
        ArgumentError: no values, a nan among them, or a share outside 0 to 1.
        MissingExtraError: SciPy is not installed.
    """
    error_share(level)
    given = numbers_of("values", values, finite=False)
    low, high = _places(len(given), share_of("share", share), level)
    rising = np.sort(given)
    return Estimate(
        float(np.quantile(given, share, method="inverted_cdf")),
        -math.inf if low is None else float(rising[low]),
        math.inf if high is None else float(rising[high]),
        level,
        len(given),
        "order statistics",
    )


@lru_cache(maxsize=1024)
def _places(runs: int, share: float, level: float) -> tuple[int | None, int | None]:
    """Which in rising order of so many runs bound a quantile; None where there is no bound."""
    tested = scipy_stats().quantile_test(np.arange(runs), q=0.0, p=share)
    low, high = tested.confidence_interval(level)
    return None if math.isnan(low) else int(low), None if math.isnan(high) else int(high)


def mean_by_run(
    runs: Sequence[ArrayLike], seed: int, level: float = LEVEL, resamples: int = RESAMPLES
) -> Estimate:
    """The mean of all values of all runs, by BCa bootstrap of whole runs.

    `runs` has the values of each run, of any number; runs without one are left out. Values of one
    run may depend on each other; runs may not. Without two runs that differ there are no bounds.

    Source: B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap (1993), 14.3; whole
    runs: A. C. Davison and D. V. Hinkley, Bootstrap Methods and their Application (1997), 3.8.

    Raises:
        ArgumentError: no values, or some that are not finite.
        MissingExtraError: SciPy is not installed.
    """
    values, run_of_value = _flat(runs)
    sums, sizes = np.bincount(run_of_value, values), np.bincount(run_of_value)
    value = float(values.mean())
    if np.allclose(sums, value * sizes):
        return Estimate(value, -math.inf, math.inf, level, len(sizes), "BCa by run")

    def means(times: Array) -> Array:
        return np.asarray((times @ sums) / (times @ sizes))

    how = _Bootstrap(len(sizes), len(sizes), "BCa", seed, level, resamples)
    low, high = _bounds(means, how)
    return Estimate(value, low, high, level, len(sizes), "BCa by run")


def quantile_by_run(
    runs: Sequence[ArrayLike],
    share: float,
    seed: int,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> Estimate:
    """A quantile of all values of all runs, by percentile bootstrap of whole runs.

    As `mean_by_run` otherwise. Where a run has one value, `quantile_by_order` is better: it is
    exact.
    """
    share_of("share", share)
    values, run_of_value = _flat(runs)
    order = np.argsort(values, kind="stable")
    rising, run_of_rising = values[order], run_of_value[order]
    known = int(run_of_value.max()) + 1

    def quantiles(times: Array) -> Array:
        counted = np.cumsum(times[:, run_of_rising], axis=1)
        wanted = share * counted[:, -1:] * (1 - 1e-12)
        return np.asarray(rising[np.count_nonzero(counted < wanted, axis=1)])

    value = float(quantiles(np.ones((1, known)))[0])
    if known < 2:
        return Estimate(value, -math.inf, math.inf, level, known, "percentile by run")
    how = _Bootstrap(known, len(values), "percentile", seed, level, resamples)
    low, high = _bounds(quantiles, how)
    return Estimate(value, low, high, level, known, "percentile by run")


def _flat(runs: Sequence[ArrayLike]) -> tuple[Array, Indices]:
    """All values one after the other, and of which run each is; empty runs do not count."""
    given = [np.asarray(run, dtype=np.float64).ravel() for run in runs]
    given = [run for run in given if len(run)]
    if not given:
        raise ArgumentError("runs: expected values, but no run has one")
    values = numbers_of("values", np.concatenate(given))
    return values, np.repeat(np.arange(len(given)), [len(run) for run in given])


@dataclass(frozen=True, slots=True)
class _Bootstrap:
    """How runs are drawn again."""

    runs: int
    numbers: int
    """How many the statistic holds in memory for each resample."""
    method: str
    seed: int
    level: float
    resamples: int


def _bounds(statistic: OfTimes, how: _Bootstrap) -> tuple[float, float]:
    """Bootstrap bounds of a statistic of how many times each run was drawn."""
    runs = how.runs

    def of_drawn(drawn: Indices, axis: int) -> Array:
        assert axis in (-1, drawn.ndim - 1)
        rows = drawn.reshape(-1, drawn.shape[-1])
        places = rows + runs * np.arange(len(rows))[:, None]
        times = np.bincount(places.ravel(), minlength=runs * len(rows)).reshape(-1, runs)
        return statistic(times.astype(np.float64)).reshape(drawn.shape[:-1])

    found = scipy_stats().bootstrap(
        (np.arange(runs),),
        of_drawn,
        vectorized=True,
        n_resamples=how.resamples,
        batch=max(1, BATCH_NUMBERS // how.numbers),
        confidence_level=1 - error_share(how.level),
        method=how.method,
        rng=np.random.default_rng(how.seed),
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)
