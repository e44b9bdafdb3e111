"""How much of the variance of an outcome over a grid is due to each factor alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.model.types import Array
from fleet.study.statistics.estimate import LEVEL, Estimate, error_share

GRID_RESAMPLES = 1000


@dataclass(frozen=True, slots=True)
class MainEffects:
    """Shares of the variance of an outcome between the conditions of a full grid.

    What the runs of one condition differ by is taken out. Shares are estimates of variance
    components: they may come out slightly below 0.
    """

    factors: dict[str, Estimate]
    """By each factor alone."""
    interactions: Estimate
    """By factors together: what is left."""
    between_conditions: Estimate
    """Standard deviation of the mean outcome between conditions, in the unit of the outcome."""


def main_effects(
    factors: Sequence[str],
    outcome: ArrayLike,
    seed: int,
    level: float = LEVEL,
    resamples: int = GRID_RESAMPLES,
) -> MainEffects:
    """Main effects of the factors of a full grid, each value of a factor as likely as another.

    `outcome` has an axis for each factor, in order, and a last one of runs (two at least). Run k of
    all conditions may be the same encounter with the same seed, and then is drawn again as one.
    Intervals are by percentile bootstrap of runs, about the estimate (which the bootstrap would
    otherwise shift by the noise that is taken out).

    Source: S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (1992), on subtracting
    the mean square of effect by run; the shares are the first-order Sobol indices of the grid.

    Raises:
        ArgumentError: axes that do not fit the factors, one run a condition, or numbers not finite.
    """
    given = np.asarray(outcome, dtype=np.float64)
    if not factors or given.ndim != len(factors) + 1 or min(given.shape) < 2:
        raise ArgumentError(
            f"outcome: expected an axis of at least two values for each of {len(factors)} factors "
            f"and one of at least two runs, not the shape {given.shape}"
        )
    if not np.isfinite(given).all():
        raise ArgumentError("outcome: expected finite numbers")
    runs = given.shape[-1]
    found = _components(given)
    drawn = np.random.default_rng(seed).integers(runs, size=(resamples, runs))
    again = np.array([_components(given[..., rows], noise=2.0) for rows in drawn])
    share = error_share(level) / 2

    def estimate(of: Array, value: float) -> Estimate:
        known = of[np.isfinite(of)]
        if not len(known) or not np.isfinite(value):
            return Estimate(float("nan"), 0.0, 1.0, level, given.size, "main effects")
        low, high = np.quantile(known, [share, 1 - share])
        return Estimate(value, float(low), float(high), level, given.size, "main effects")

    with np.errstate(invalid="ignore", divide="ignore"):
        shares, all_shares = found[:-1] / found[-1], again[:, :-1] / again[:, -1:]
    every = [estimate(all_shares[:, k], float(s)) for k, s in enumerate(shares)]
    spread = estimate(np.sqrt(np.maximum(again[:, -1], 0)), float(max(found[-1], 0) ** 0.5))
    return MainEffects(dict(zip(factors, every[:-1], strict=True)), every[-1], spread)


def _components(outcome: Array, noise: float = 1.0) -> Array:
    """Variance components: of each factor alone, of interactions, and of all between conditions."""
    runs, axes = outcome.shape[-1], range(outcome.ndim - 1)
    total = _between(outcome.reshape(-1, runs), noise)
    alone = [
        _between(outcome.mean(axis=tuple(other for other in axes if other != axis)), noise)
        for axis in axes
    ]
    return np.array([*alone, total - sum(alone), total])


def _between(effects: Array, noise: float) -> float:
    """The variance of effects (values, runs) between values, less what runs add to that of means.

    What a run adds to all values alike, as an encounter does that is flown at each, adds nothing.
    Where runs are drawn again they add it twice (`noise`): once as they were, once by the drawing.
    """
    values, runs = effects.shape
    means = effects.mean(axis=1)
    rest = effects - means[:, None] - effects.mean(axis=0) + means.mean()
    of_runs = float((rest * rest).sum()) / ((values - 1) * (runs - 1)) / runs
    return float(means.var() - noise * of_runs * (values - 1) / values)
