"""How much of the variance of an outcome is due to each factor: Sobol indices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.extras import import_extra
from fleet.model.types import Array
from fleet.study.statistics.estimate import (
    LEVEL,
    Estimate,
    error_share,
    numbers_of,
    scipy_stats,
)

SOBOL_RESAMPLES = 1000


@dataclass(frozen=True, slots=True)
class FactorShare:
    """What one factor does to an outcome, as shares of the variance of the outcome."""

    factor: str
    first: Estimate
    """First order: by the factor alone, averaged over all others. May come out slightly below 0."""
    total: Estimate
    """Total: by the factor alone and together with others."""


def saltelli_points(factors: int, size: int, seed: int) -> Array:
    """The design for `sobol_shares`: shape (size (factors + 2), factors), uniform from 0 to 1.

    Two scrambled Sobol samples A and B of `size` rows each, one below the other, then for each
    factor A with the column of that factor from B.

    Source: A. Saltelli and others, Computer Physics Communications 181 (2010), 259.

    Raises:
        ArgumentError: no factor, or a size that is not a power of two, 2 at least.
        MissingExtraError: SciPy is not installed.
    """
    if factors < 1 or size < 2 or size & (size - 1):
        raise ArgumentError(
            f"expected factors and a power of two as size, not {factors} and {size}"
        )
    sobol = import_extra("scipy.stats.qmc", "study", "the statistics of a study").Sobol
    rows = sobol(2 * factors, rng=np.random.default_rng(seed)).random(size)
    first, second = rows[:, :factors], rows[:, factors:]
    mixed = [first.copy() for _ in range(factors)]
    for k, part in enumerate(mixed):
        part[:, k] = second[:, k]
    return np.concatenate([first, second, *mixed])


def sobol_shares(
    factors: Sequence[str],
    outcome: ArrayLike,
    seed: int,
    level: float = LEVEL,
    resamples: int = SOBOL_RESAMPLES,
) -> tuple[FactorShare, ...]:
    """First-order and total Sobol indices of each factor, with percentile bootstrap of the rows.

    `outcome` has one number for each row of `saltelli_points`, in its order. It should be a
    function of the factors: fly all rows with one seed, or what the seed does counts as an
    interaction of every factor. Rows of a Sobol sequence are more even than those that the
    bootstrap draws, so the intervals are on the safe side. If the outcome never changes, all are
    nan, from 0 to 1.

    Raises:
        ArgumentError: another number of rows, or some that are not finite.
        MissingExtraError: SciPy is not installed.
    """
    size, rest = divmod(len(np.asarray(outcome)), len(factors) + 2) if factors else (0, 1)
    if rest or size < 2 or size & (size - 1):
        raise ArgumentError(
            f"outcome: expected a power of two times {len(factors) + 2} rows of a Saltelli design, "
            f"not {len(np.asarray(outcome))}"
        )
    parts = numbers_of("outcome", outcome).reshape(len(factors) + 2, size)
    if np.ptp(parts) == 0:
        nothing = Estimate(np.nan, 0.0, 1.0, level, parts.size, "sobol")
        return tuple(FactorShare(name, nothing, nothing) for name in factors)
    stats = scipy_stats()
    functions = {"f_A": parts[:1], "f_B": parts[1:2], "f_AB": parts[2:, None, :]}
    found = stats.sobol_indices(func=functions, n=size)
    drawn = np.random.default_rng(seed).integers(size, size=(resamples, size))
    again = np.array([_indices(parts[:, rows]) for rows in drawn])
    share = error_share(level) / 2
    low, high = np.nanquantile(again, [share, 1 - share], axis=0)

    def estimate(order: int, factor: int) -> Estimate:
        value = (found.first_order, found.total_order)[order][factor]
        bounds = float(low[order, factor]), float(high[order, factor])
        return Estimate(float(value), *bounds, level, parts.size, "sobol")

    return tuple(
        FactorShare(name, estimate(0, k), estimate(1, k)) for k, name in enumerate(factors)
    )


def _indices(parts: Array) -> Array:
    """First and total indices, (2, factors), of outcomes at A, B and the mixed designs.

    As scipy.stats.sobol_indices, whose own bootstrap takes no generator.
    """
    parts = parts - parts[:2].mean()
    variance = parts[:2].var()
    first = (parts[1] * (parts[2:] - parts[0])).mean(axis=1)
    total = ((parts[0] - parts[2:]) ** 2).mean(axis=1) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.array([first, total]) / variance)
