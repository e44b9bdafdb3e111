"""What avoidance is worth on common encounters: each flown with it and without it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.study.statistics.estimate import (
    LEVEL,
    Estimate,
    normal_quantile,
    truths_of,
)
from fleet.study.statistics.proportions import (
    ProportionMethod,
    proportion,
    score_bounds,
)


@dataclass(frozen=True, slots=True)
class PairedCounts:
    """How many encounters had an event under which of two conditions.

    The conditions may be with and without avoidance, or any two of a study that are flown on the
    same encounters with the same seeds.
    """

    both: int
    """Under both conditions."""
    first_only: int
    """Under the first condition alone."""
    second_only: int
    """Under the second condition alone."""
    neither: int
    """Under none."""

    @classmethod
    def of(cls, first: ArrayLike, second: ArrayLike) -> PairedCounts:
        """Count the truths of each encounter under both conditions, in the same order.

        Raises:
            ArgumentError: they are not of the same encounters, or no truths.
        """
        one, other = truths_of("first", first), truths_of("second", second)
        if len(one) != len(other):
            raise ArgumentError(
                f"expected the same encounters twice, not {len(one)} and {len(other)} runs"
            )
        counts = (one & other, one & ~other, ~one & other, ~one & ~other)
        return cls(*(int(np.count_nonzero(c)) for c in counts))

    @property
    def encounters(self) -> int:
        """How many were flown."""
        return self.both + self.first_only + self.second_only + self.neither

    @property
    def first(self) -> int:
        """Events under the first condition."""
        return self.both + self.first_only

    @property
    def second(self) -> int:
        """Events under the second condition."""
        return self.both + self.second_only


@dataclass(frozen=True, slots=True)
class AvoidanceEffect:
    """Losses of encounters that were flown with avoidance and, all else the same, without it."""

    counts: PairedCounts
    """The first condition is with avoidance, the second without."""
    lost_with: Estimate
    lost_without: Estimate
    ratio: Estimate
    """The risk ratio: probability of a loss with avoidance by that without."""
    difference: Estimate
    """The probability with avoidance less that without; negative if avoidance helps."""
    induced: Estimate
    """The probability that an encounter is lost with avoidance, and only with it."""
    unresolved: Estimate
    """The probability that an encounter is lost with avoidance and without it."""


def effect_of_avoidance(
    lost_with: ArrayLike,
    lost_without: ArrayLike,
    level: float = LEVEL,
    method: ProportionMethod = "exact",
) -> AvoidanceEffect:
    """Compare losses with and without avoidance: one truth an encounter each, in the same order.

    `method` is that of the four probabilities.

    Raises:
        ArgumentError: the truths are not of the same encounters, or no truths.
        MissingExtraError: SciPy is not installed.
    """
    counts = PairedCounts.of(lost_with, lost_without)

    def share(events: int) -> Estimate:
        return proportion(events, counts.encounters, level, method)

    return AvoidanceEffect(
        counts,
        lost_with=share(counts.first),
        lost_without=share(counts.second),
        ratio=risk_ratio(counts, level),
        difference=risk_difference(counts, level),
        induced=share(counts.first_only),
        unresolved=share(counts.both),
    )


def risk_ratio(counts: PairedCounts, level: float = LEVEL) -> Estimate:
    """The probability under the first condition by that under the second, from common encounters.

    Bonett and Price's hybrid of two Wilson intervals of those encounters that had an event, which
    is bounded below with no event under the first condition, and has no upper bound with none under
    the second. With none under either it is nan, between 0 and infinity.

    Source: D. G. Bonett and R. M. Price, Statistics in Medicine 25 (2006), 3039; recommended by
    M. W. Fagerland, S. Lydersen and P. Laake, Statistics in Medicine 33 (2014), 2850.
    """
    z = normal_quantile(level)
    first, second, method = counts.first, counts.second, "bonett-price"
    events = counts.encounters - counts.neither
    if events == 0:
        return Estimate(math.nan, 0.0, math.inf, level, counts.encounters, method)
    spread_of_ratio = math.sqrt(
        (counts.first_only + counts.second_only + 2) / ((first + 1) * (second + 1))
    )
    spreads = sum(
        math.sqrt((1 - (count + 1) / (events + 2)) / (count + 1)) for count in (first, second)
    )
    z *= spread_of_ratio / spreads
    first_low, first_high = score_bounds(first, events, z)
    second_low, second_high = score_bounds(second, events, z)
    return Estimate(
        first / second if second else math.inf,
        first_low / second_high,
        first_high / second_low if second else math.inf,
        level,
        counts.encounters,
        method,
    )


def risk_difference(counts: PairedCounts, level: float = LEVEL) -> Estimate:
    """The probability under the first condition less that under the second.

    Newcombe's square-and-add interval of two Wilson intervals and their correlation (method 10).

    Source: R. G. Newcombe, Statistics in Medicine 17 (1998), 2635.
    """
    z, total = normal_quantile(level), counts.encounters
    first, second = counts.first / total, counts.second / total
    first_low, first_high = score_bounds(counts.first, total, z)
    second_low, second_high = score_bounds(counts.second, total, z)
    correlation = _correlation(counts)

    def reach(one: float, other: float) -> float:
        square = one * one - 2 * correlation * one * other + other * other
        return math.sqrt(max(0.0, square))

    return Estimate(
        first - second,
        first - second - reach(first - first_low, second_high - second),
        first - second + reach(first_high - first, second - second_low),
        level,
        total,
        "newcombe",
    )


def _correlation(counts: PairedCounts) -> float:
    """Newcombe's phi, corrected towards 0 by half the number of encounters where it is positive."""
    total = counts.encounters
    margins = counts.first * (total - counts.first) * counts.second * (total - counts.second)
    if margins == 0:
        return 0.0
    excess = counts.both * counts.neither - counts.first_only * counts.second_only
    if excess > 0:
        return max(excess - total / 2, 0) / math.sqrt(margins)
    return excess / math.sqrt(margins)
