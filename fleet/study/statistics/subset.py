"""Small probabilities by subset simulation: a rare event as a sequence of events that are not."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.model.types import Array, Truths
from fleet.study.statistics.estimate import (
    LEVEL,
    Estimate,
    error_share,
    scipy_stats,
    share_of,
)

Limit = Callable[[Array], ArrayLike]
"""Of points (n, dimensions) of independent standard normal numbers the n performances: the event
happens where they are 0 or below. The greater, the further from it."""

ACCEPTED = 0.44
"""The share of proposals that is aimed at when the step of chains is adapted."""
FIRST_STEP = 0.6
"""The step of chains before it is adapted: 1 draws anew, 0 stays."""
BIAS = 5.0
"""Allowance for what chains put the estimate too high: so many parts of it for each subset, divided
by the points, as `benchmarks.coverage` measures at most."""

_Repeat = Generator[Array, Array, "SubsetRepeat"]


@dataclass(frozen=True, slots=True)
class SubsetRepeat:
    """What one of the independent repeats came to."""

    probability: float
    """Its estimate; 0 where the event was not reached."""
    thresholds: tuple[float, ...]
    """The performances that bound the subsets, falling; the last is 0 if the event was reached."""
    evaluations: int
    """How many points were evaluated."""


@dataclass(frozen=True, slots=True)
class RareEvent:
    """The probability of a rare event, from independent repeats of subset simulation."""

    estimate: Estimate
    """`runs` are all evaluations."""
    variation: float
    """Coefficient of variation of the estimate, from the spread of the repeats."""
    repeats: tuple[SubsetRepeat, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SubsetPlan:
    """How much is spent on a rare event.

    Each of `repeats` holds `points` points, of which about `share` go on from one subset to the
    next: a probability of share^k takes about points (1 + (1 - share) (k - 1)) evaluations, and k
    subsets, of which there may be `most_subsets`.

    Raises:
        ArgumentError: fewer than two repeats or 20 points, a share of no or of nearly all points.
    """

    points: int = 500
    share: float = 0.1
    repeats: int = 10
    most_subsets: int = 12

    def __post_init__(self) -> None:
        """Refuse a plan that estimates nothing."""
        share_of("share", self.share)
        if self.repeats < 2 or self.points < 20 or self.most_subsets < 1 or self.share > 0.5:
            raise ArgumentError(
                "expected 2 repeats of 20 points or more, a share of 0.5 at most and a subset, not "
                f"{self.repeats} of {self.points}, {self.share} and {self.most_subsets}"
            )


DEFAULT_PLAN = SubsetPlan()


def subset_simulation(
    limit: Limit,
    dimensions: int,
    seed: int,
    plan: SubsetPlan = DEFAULT_PLAN,
    level: float = LEVEL,
    *,
    redrawn: int = 0,
) -> RareEvent:
    """The probability that `limit` is 0 or below at a standard normal point.

    What points of all repeats can be evaluated at one time is given to `limit` together, so that it
    may share them out. Chains move by the preconditioned Crank-Nicolson proposal, with a step that
    is adapted to how many are accepted; any number of dimensions will do. The last `redrawn` of
    them are seeds, where a little more is something else altogether: each of these is drawn anew,
    with the square of the step for its probability, or stays.

    The interval is that of the mean of log-normal numbers (Cox's method, with Student's t) from the
    spread of the repeats, since points of one chain, and subsets one after the other, depend on
    each other; it allows for the bias of chains. If no repeat reaches the event, the value is 0,
    from 0 to 1: it was not found.

    Sources: S. K. Au and J. L. Beck, Probabilistic Engineering Mechanics 16 (2001), 263; the
    chains: I. Papaioannou, W. Betz, K. Zwirglmaier and D. Straub, Probabilistic Engineering
    Mechanics 41 (2015), 89; the interval: X.-H. Zhou and S. Gao, Statistics in Medicine 16 (1997),
    783.

    Raises:
        ArgumentError: no dimension, or `limit` gives other than one number that is not nan a point.
        MissingExtraError: SciPy is not installed.
    """
    if dimensions < 1:
        raise ArgumentError(f"dimensions: expected at least one, not {dimensions}")
    if not 0 <= redrawn <= dimensions:
        raise ArgumentError(f"redrawn: expected 0 to {dimensions}, not {redrawn}")
    streams = np.random.default_rng(seed).spawn(plan.repeats)
    seeds = np.arange(dimensions) >= dimensions - redrawn
    repeats = _together([_repeat(rng, seeds, plan) for rng in streams], limit)
    return _summary(repeats, plan.points, level)


def _together(running: Sequence[_Repeat], limit: Limit) -> list[SubsetRepeat]:
    """Carry repeats on side by side, and evaluate what they ask for in one batch."""
    asked = {k: next(repeat) for k, repeat in enumerate(running)}
    done: dict[int, SubsetRepeat] = {}
    while asked:
        sizes = [len(points) for points in asked.values()]
        values = _evaluated(limit, np.concatenate([*asked.values()]))
        for k, part in zip([*asked], np.split(values, np.cumsum(sizes)[:-1]), strict=True):
            try:
                asked[k] = running[k].send(part)
            except StopIteration as end:
                done[k] = end.value
                del asked[k]
    return [done[k] for k in range(len(running))]


def _evaluated(limit: Limit, points: Array) -> Array:
    values = np.asarray(limit(points), dtype=np.float64)
    if values.shape != (len(points),) or np.isnan(values).any():
        raise ArgumentError(
            f"limit: expected one number for each of {len(points)} points, and none of them nan"
        )
    return values


def _repeat(rng: np.random.Generator, seeds: Truths, plan: SubsetPlan) -> _Repeat:
    """One repeat: asks for points to be evaluated, and is told their values."""
    points = rng.standard_normal((plan.points, len(seeds)))
    values = yield points
    evaluations, probability, step = plan.points, 1.0, FIRST_STEP
    thresholds: list[float] = []
    while len(thresholds) < plan.most_subsets:
        threshold = _threshold(values, plan.share)
        if threshold is None:
            break
        inside = _within(values, threshold)
        probability *= np.count_nonzero(inside) / len(values)
        thresholds.append(threshold)
        if threshold == 0:
            return SubsetRepeat(probability, tuple(thresholds), evaluations)
        evaluations += int(np.count_nonzero(~inside))
        points, values, step = yield from _chains(rng, seeds, points, values, (threshold, step))
    return SubsetRepeat(0.0, tuple(thresholds), evaluations)


def _within(values: Array, threshold: float) -> Truths:
    """Which points are in a subset: strictly nearer than its bound, or in the event itself.

    The point that set the bound is left out. It is where it is because of that, and chains from it
    would make the estimate several percent too high.
    """
    return values < threshold if threshold > 0 else values <= 0


def _threshold(values: Array, share: float) -> float | None:
    """The bound of the next subset; None where no point is nearer to the event than another.

    Performances may be equal, as where nothing happens in most runs: then the subset has more
    points than wanted, or fewer where it would have all.
    """
    rising, wanted = np.sort(values), max(1, round(share * len(values)))
    last = rising[wanted - 1]
    if last <= 0:
        return 0.0
    beyond = np.searchsorted(rising, last, side="right")
    if beyond < len(rising):
        return float(rising[beyond])
    return float(last) if rising[0] < last else None


def _chains(
    rng: np.random.Generator,
    seeds: Truths,
    points: Array,
    values: Array,
    bounds: tuple[float, float],
) -> Generator[Array, Array, tuple[Array, Array, float]]:
    """As many points as there were, all within the subset: chains from those that were in it.

    `bounds` are the threshold of the subset and the step to begin with.
    """
    threshold, step = bounds
    inside = rng.permutation(np.flatnonzero(_within(values, threshold)))
    here, its = points[inside], values[inside]
    found, known = [here], [its]
    missing, move = len(points) - len(inside), 0
    while missing:
        move += 1
        moving = min(missing, len(inside))
        here, its = here[:moving], its[:moving]
        fresh = rng.standard_normal(here.shape)
        proposed = math.sqrt(1 - step * step) * here + step * fresh
        if seeds.any():
            anew = rng.random(here.shape) < step * step
            proposed = np.where(seeds, np.where(anew, fresh, here), proposed)
        at_proposed = yield proposed
        accepted = _within(at_proposed, threshold)
        here = np.where(accepted[:, None], proposed, here)
        its = np.where(accepted, at_proposed, its)
        found.append(here)
        known.append(its)
        missing -= moving
        aim = math.log(step) + (float(accepted.mean()) - ACCEPTED) / math.sqrt(move)
        step = min(1.0, math.exp(aim))
    return np.concatenate(found), np.concatenate(known), step


def _summary(repeats: Sequence[SubsetRepeat], points: int, level: float) -> RareEvent:
    """The mean of independent repeats, and its interval."""
    found = np.array([repeat.probability for repeat in repeats])
    value, evaluations = float(found.mean()), sum(repeat.evaluations for repeat in repeats)
    method = "log-normal of repeats"
    if value == 0:
        nothing = Estimate(0.0, 0.0, 1.0, level, evaluations, method)
        return RareEvent(nothing, math.inf, tuple(repeats))
    middle, spread = _log_normal(found)
    bias = BIAS * float(np.mean([len(repeat.thresholds) for repeat in repeats])) / points
    student = float(scipy_stats().t.isf(error_share(level) / 2, len(found) - 1))
    reach = student * math.sqrt(spread * spread + bias * bias)
    low, high = math.exp(middle - reach), min(1.0, math.exp(middle + reach))
    variation = float(found.std(ddof=1)) / value / math.sqrt(len(found))
    estimate = Estimate(value, low, high, level, evaluations, method)
    return RareEvent(estimate, variation, tuple(repeats))


def _log_normal(found: Array) -> tuple[float, float]:
    """Logarithm of the mean of log-normal numbers and its standard error, by Cox's method.

    If some are 0, by their mean and spread.
    """
    count = len(found)
    if (found > 0).all():
        logarithms = np.log(found)
        variance = float(logarithms.var(ddof=1))
        middle = float(logarithms.mean()) + variance / 2
    else:
        mean = float(found.mean())
        variance = math.log1p(float(found.var(ddof=1)) / (mean * mean))
        middle = math.log(mean)
    return middle, math.sqrt(variance / count + variance * variance / 2 / (count - 1))
