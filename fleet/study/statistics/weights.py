"""The probability of an event from runs that were drawn more often than they happen, by weights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.model.types import Array
from fleet.study.statistics.estimate import (
    LEVEL,
    Estimate,
    error_share,
    numbers_of,
    scipy_stats,
    truths_of,
)
from fleet.study.statistics.proportions import exact_bounds


@dataclass(frozen=True, slots=True)
class WeightedProportion:
    """A probability from weighted runs, and how many runs of weight one they are worth."""

    estimate: Estimate
    effective_runs: float
    """Kish's effective sample size of all runs."""
    effective_events: float
    """The same of the runs with the event; below about 10 the interval is rough."""


def effective_runs(weights: ArrayLike) -> float:
    """Kish's effective sample size, (sum w)^2 / sum w^2: how many equal weights say as much.

    Source: L. Kish, Survey Sampling (1965).

    Raises:
        ArgumentError: weights that are not positive and finite.
    """
    given = _checked(weights)
    return float(given.sum() ** 2 / (given @ given))


def weighted_proportion(
    events: ArrayLike, weights: ArrayLike, level: float = LEVEL
) -> WeightedProportion:
    """The probability of an event from one truth and one importance weight a run.

    A weight is how often such an encounter happens by how often it is drawn, up to a common factor.
    The value is the weighted share. The interval is Clopper-Pearson's of as many runs as would give
    the variance of that share by linearisation (Korn and Graubard, with Student's t of the
    effective runs less one, since the variance is estimated of no more); without an event, or with
    nothing else, of as many as Kish's effective sample size. It cannot know of encounters that are
    dangerous, frequent and hardly ever drawn: weights should be bounded, and small where events
    are.

    Source: E. L. Korn and B. I. Graubard, Survey Methodology 24 (1998), 193.

    Raises:
        ArgumentError: not one truth and one weight a run, weights not positive and finite.
        MissingExtraError: SciPy is not installed.
    """
    happened, given = truths_of("events", events), _checked(weights)
    if len(happened) != len(given):
        raise ArgumentError(f"expected a weight a run, not {len(given)} of {len(happened)} runs")
    total = float(given.sum())
    value = float(given[happened].sum()) / total
    worth = effective_runs(given)
    if happened.any() and not happened.all():
        deviations = given * (happened - value) / total
        variance = float(deviations @ deviations) * len(given) / (len(given) - 1)
        student = scipy_stats().t.isf(error_share(level) / 2, [len(given) - 1, max(worth - 1, 1)])
        worth_of_share = value * (1 - value) / variance * float(student[0] / student[1]) ** 2
    else:
        worth_of_share = worth
    low, high = exact_bounds(value * worth_of_share, worth_of_share, level)
    estimate = Estimate(value, low, high, level, len(given), "korn-graubard")
    events_worth = effective_runs(given[happened]) if happened.any() else 0.0
    return WeightedProportion(estimate, worth, events_worth)


def weighted_risk_ratio(
    first: ArrayLike, second: ArrayLike, weights: ArrayLike, level: float = LEVEL
) -> Estimate:
    """The probability under the first condition by that under the second, of weighted encounters.

    By two intervals of `weighted_proportion` that together miss as seldom as `level` asks for
    (Bonferroni): wider than need be, since it makes no use of their being flown on the same
    encounters, and as good as these where few encounters weigh most. Without an event under the
    second condition it has no upper bound.

    Raises:
        ArgumentError: not one truth each and one weight an encounter.
        MissingExtraError: SciPy is not installed.
    """
    each = 0.5 * (1.0 + level)
    one, other = (weighted_proportion(e, weights, each).estimate for e in (first, second))
    by_nothing = math.inf if one.value else math.nan
    value = one.value / other.value if other.value else by_nothing
    high = one.high / other.low if other.low else math.inf
    return Estimate(value, one.low / other.high, high, level, one.runs, "korn-graubard, twice")


def _checked(weights: ArrayLike) -> Array:
    given = numbers_of("weights", weights)
    if (given <= 0).any():
        raise ArgumentError(
            f"weights: {np.count_nonzero(given <= 0)} of {len(given)} are not positive"
        )
    return np.asarray(given / given.max())
