"""Simulated studies of known truth: a case for each line of the table of `benchmarks.coverage`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from scipy.stats import chi2, norm

from fleet.model.types import Array, Truths
from fleet.study.statistics.estimate import Estimate
from fleet.study.statistics.main_effects import main_effects
from fleet.study.statistics.mcnemar import compare_conditions
from fleet.study.statistics.paired import PairedCounts, risk_difference, risk_ratio
from fleet.study.statistics.proportions import ProportionMethod, proportion
from fleet.study.statistics.quantiles import mean_by_run, quantile_by_order, quantile_by_run
from fleet.study.statistics.sensitivity import saltelli_points, sobol_shares
from fleet.study.statistics.stopping import StoppingRule
from fleet.study.statistics.subset import Limit, subset_simulation
from fleet.study.statistics.survival import BandKind, survival_of
from fleet.study.statistics.weights import weighted_proportion, weighted_risk_ratio

Study = Callable[[int], Estimate]
"""One simulated study, from the number of its seed."""


@dataclass(frozen=True)
class Case:
    """One line of the table."""

    interval: str
    of: str
    truth: float
    study: Study
    rare: bool = False
    """Whether it is flown as often as `--rare` says."""


# Probabilities


def of_counts(runs: int, truth: float, method: ProportionMethod, seed: int) -> Estimate:
    """A probability from so many runs."""
    return proportion(int(np.random.default_rng(seed).binomial(runs, truth)), runs, method=method)


@dataclass(frozen=True)
class Encounters:
    """Encounters flown twice: probability of a loss without avoidance, ratio, and induced."""

    runs: int
    without: float
    ratio: float
    induced: float

    def flown(self, seed: int) -> PairedCounts:
        """Counts of one study."""
        both = self.without * self.ratio - self.induced
        shares = [both, self.induced, self.without - both]
        drawn = np.random.default_rng(seed).multinomial(self.runs, [*shares, 1 - sum(shares)])
        return PairedCounts(*map(int, drawn))

    def ratio_of(self, seed: int) -> Estimate:
        """The risk ratio of one study."""
        return risk_ratio(self.flown(seed))

    def difference_of(self, seed: int) -> Estimate:
        """The risk difference of one study."""
        return risk_difference(self.flown(seed))

    def __str__(self) -> str:
        """What it is called in the table."""
        return f"{self.runs} encounters, P {self.without:g} without, ratio {self.ratio:g}"


PAIRED = [
    Encounters(300, 0.2, 0.1, 0.01),
    Encounters(1000, 0.3, 1.0, 0.05),
    Encounters(1000, 0.05, 0.1, 0.002),
    Encounters(1000, 0.02, 0.02, 0.0002),
]


def weighted(runs: int, plain: float, reach: float, seed: int) -> Estimate:
    """Miss distances from 0 to 10: all but a share `plain` drawn near 0, danger below `reach`."""
    _, lost, weights = weighted_encounters(runs, plain, reach, np.random.default_rng(seed))
    return weighted_proportion(lost, weights).estimate


def weighted_encounters(
    runs: int, plain: float, reach: float, rng: np.random.Generator
) -> tuple[Array, Truths, Array]:
    """Miss distances, which of them are lost, and weights."""
    near = -np.log(1 - rng.random(runs) * (1 - math.exp(-10)))
    miss = np.where(rng.random(runs) < plain, 10 * rng.random(runs), near)
    density = plain / 10 + (1 - plain) * np.exp(-miss) / (1 - math.exp(-10))
    lost = rng.random(runs) < 0.5 * np.exp(-((miss / reach) ** 2))
    return miss, lost, 0.1 / density


def weighted_ratio(runs: int, plain: float, left: float, seed: int) -> Estimate:
    """Of what is dangerous below 1 of 10, avoidance leaves a share, the more the nearer."""
    rng = np.random.default_rng(seed)
    miss, lost, weights = weighted_encounters(runs, plain, 1.0, rng)
    with_avoidance = lost & (rng.random(runs) < 2.0 * left * np.exp(-miss))
    return weighted_risk_ratio(with_avoidance, lost, weights)


def share_left(left: float) -> float:
    """The risk ratio of `weighted_ratio`."""
    miss = np.linspace(0.0, 10.0, 1_000_001)
    lost = np.exp(-(miss**2))
    return float((lost * np.minimum(1.0, 2.0 * left * np.exp(-miss))).sum() / lost.sum())


def chance_of_loss(reach: float) -> float:
    """The mean of 0.5 exp(-(d / reach)^2) over d from 0 to 10."""
    return 0.5 * reach * math.sqrt(math.pi) / 2 * math.erf(10 / reach) / 10


@cache
def looked_at(rule: StoppingRule, events: int, runs: int) -> Estimate:
    """An interval of a study that is not over."""
    return rule.estimate(events, runs)


def stopped(half_width: float, truth: float, seed: int) -> Estimate:
    """A study that looks after each run, and stops when it knows enough."""
    rule, rng, events, runs = StoppingRule(half_width, 10**6), np.random.default_rng(seed), 0, 0
    while not runs or looked_at(rule, events, runs).half_width > half_width:
        events, runs = events + int(rng.random() < truth), runs + 1
    return looked_at(rule, events, runs)


def worst_look(half_width: float, truth: float, seed: int) -> Estimate:
    """The interval, of all that a study of 1,000 runs could have stopped with, that misses most."""
    counts = np.cumsum(np.random.default_rng(seed).random(1000) < truth)
    rule = StoppingRule(half_width, 10**6)
    looks = [looked_at(rule, int(k), n) for n, k in enumerate(counts, 1)]
    return max(looks, key=lambda look: max(look.low - truth, truth - look.high))


def worst_exact_look(truth: float, seed: int) -> Estimate:
    """The same of Clopper-Pearson intervals, which are not made for that."""
    counts = np.cumsum(np.random.default_rng(seed).random(1000) < truth)
    looks = [exact(int(k), n) for n, k in enumerate(counts, 1)]
    return max(looks, key=lambda look: max(look.low - truth, truth - look.high))


exact = cache(proportion)


def probabilities() -> Iterator[Case]:
    """Events in runs."""
    methods: tuple[ProportionMethod, ...] = ("exact", "wilson")
    for method in methods:
        for runs, truth in ((300, 0.005), (300, 0.1), (3000, 0.5)):
            of = f"{runs} runs, P {truth:g}"
            yield Case(f"P, {method}", of, truth, partial(of_counts, runs, truth, method))
    for e in PAIRED:
        yield Case("risk ratio", f"{e}", e.ratio, e.ratio_of)
    for e in PAIRED:
        less = e.without * (e.ratio - 1)
        yield Case("risk difference", f"{e}", less, e.difference_of)
    for runs, plain, reach in ((300, 0.2, 1.0), (1000, 0.1, 0.3), (1000, 0.02, 3.0)):
        of = f"{runs} runs, {plain:.0%} of them drawn plainly, danger below {reach:g} of 10"
        truth = chance_of_loss(reach)
        yield Case("P, weighted", of, truth, partial(weighted, runs, plain, reach))
    for runs, plain, left in ((300, 0.2, 0.05), (300, 0.2, 0.4), (1000, 0.1, 0.02)):
        of = f"{runs} runs, {plain:.0%} of them drawn plainly, {left:g} left"
        ratio_of = partial(weighted_ratio, runs, plain, left)
        yield Case("risk ratio, weighted", of, share_left(left), ratio_of)
    for truth in (0.02, 0.3):
        of = f"P {truth:g}, until known to 0.05"
        yield Case("P, stopped early", of, truth, partial(stopped, 0.05, truth))
        of = f"P {truth:g}, the worst of 1,000 looks"
        yield Case("P, stopped early", of, truth, partial(worst_look, 0.05, truth))
        yield Case("P, exact, *misused*", of, truth, partial(worst_exact_look, truth))


# Values


def ragged(runs: int, seed: int) -> list[Array]:
    """Log-normal values of 1 to 8 pairs a run, four fifths of whose variance is the run's."""
    rng = np.random.default_rng(seed)
    of_runs, sizes = rng.normal(size=runs), rng.integers(1, 9, size=runs)
    return [np.exp(r + 0.5 * rng.normal(size=n)) for r, n in zip(of_runs, sizes, strict=True)]


def in_band(runs: int, band: BandKind, seed: int) -> Estimate:
    """Whether a whole curve, or its worst pointwise place of one, is within its band."""
    values = np.random.default_rng(seed).random(runs)
    if band == "pointwise":
        curve = survival_of(values, at=[0.9], band=band)
        return Estimate(0.1, float(curve.low[0]), float(curve.high[0]), 0.95, runs, band)
    curve = survival_of(values)
    after = np.concatenate([[0.0], curve.at[:-1]])
    inside = (curve.low <= 1 - curve.at).all() and (curve.high >= 1 - after).all()
    middle = float(curve.high[runs // 2] - curve.low[runs // 2]) / 2
    return Estimate(0.0, -middle if inside else middle, middle, 0.95, runs, band)


def by_order(runs: int, share: float, seed: int) -> Estimate:
    """A quantile of one log-normal value a run."""
    return quantile_by_order(np.random.default_rng(seed).lognormal(size=runs), share)


def by_run(runs: int, share: float, seed: int) -> Estimate:
    """A quantile of several values a run."""
    return quantile_by_run(ragged(runs, seed), share, seed)


def mean(runs: int, seed: int) -> Estimate:
    """The mean of several values a run."""
    return mean_by_run(ragged(runs, seed), seed)


def values() -> Iterator[Case]:
    """Values of runs."""
    for runs, share in ((50, 0.5), (300, 0.05), (300, 0.95)):
        of, truth = f"{share:.0%}, one value a run, {runs} runs", math.exp(norm.ppf(share))
        yield Case("quantile, order statistics", of, truth, partial(by_order, runs, share))
    for runs, share in ((50, 0.5), (300, 0.5), (300, 0.95)):
        of = f"{share:.0%}, 1 to 8 pairs a run, {runs} runs"
        truth = math.exp(math.sqrt(1.25) * norm.ppf(share))
        yield Case("quantile by run", of, truth, partial(by_run, runs, share))
    for runs in (50, 300, 1000):
        of = f"1 to 8 pairs a run, {runs} runs, log-normal"
        yield Case("mean by run", of, math.exp(1.25 / 2), partial(mean, runs))
    whole = "the whole curve, 300 runs"
    yield Case("survival, simultaneous", whole, 0.0, partial(in_band, 300, "simultaneous"))
    yield Case("survival, pointwise", "at 0.1, 300 runs", 0.1, partial(in_band, 300, "pointwise"))


# Factors


def alarms(seed: int) -> Estimate:
    """Whether McNemar and Holm call any of six conditions different that are alike."""
    rng = np.random.default_rng(seed)
    hard = rng.random(1000) < 0.3
    lost = {str(k): hard & (rng.random(1000) < 0.5) for k in range(6)}
    least = min(test.adjusted_p_value for test in compare_conditions(lost))
    return Estimate(least, 0.0 if least > 0.05 else 1.0, 1.0, 0.95, 1000, "holm")


def ishigami(unit: Array) -> Array:
    """The function that sensitivity methods are tried on."""
    x = math.pi * (2 * unit - 1)
    return np.asarray(
        np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    )


def index(order: str, seed: int) -> Estimate:
    """The first-order or total index of the first factor."""
    shares = sobol_shares("abc", ishigami(saltelli_points(3, 256, seed)), seed)
    return shares[0].first if order == "first" else shares[0].total


def grid(seed: int) -> Estimate:
    """Share of the first factor of 4 x 3 conditions with 40 common runs."""
    rng = np.random.default_rng(seed)
    one, other = np.arange(4)[:, None, None], np.arange(3)[None, :, None]
    noise = 3 * rng.normal(size=(4, 3, 40)) + 5 * rng.normal(size=40)
    found = main_effects("ab", one + 2 * other + 0.5 * one * other + noise, seed)
    return found.factors["a"]


def factors() -> Iterator[Case]:
    """Comparisons and sensitivity."""
    yield Case("McNemar, Holm", "no false alarm, 15 pairs of 6 conditions", 0.0, alarms)
    a, b, one = 7.0, 0.1, (1 + 0.1 * math.pi**4 / 5) ** 2 / 2
    both = 8 * b * b * math.pi**8 / 225
    total = one + both + a * a / 8
    for order, truth in (("first", one / total), ("total", (one + both) / total)):
        yield Case(
            f"Sobol index, {order}",
            "Ishigami's function, 256 (3 + 2) rows",
            truth,
            partial(index, order),
        )
    yield Case("main effect", "4 x 3 conditions, 40 common runs", 2.8125 / 8.0625, grid)


# Rare events


def plane(probability: float, dimensions: int) -> Limit:
    """The event beyond a plane."""
    beyond = -norm.ppf(probability)
    return lambda points: beyond - points.sum(axis=1) / math.sqrt(dimensions)


def ball(probability: float, dimensions: int) -> Limit:
    """The event outside of a ball."""
    beyond = chi2.isf(probability, dimensions)
    return lambda points: beyond - (points * points).sum(axis=1)


def steps(probability: float, dimensions: int) -> Limit:
    """The event beyond a plane, told in steps of a quarter."""
    smooth = plane(probability, dimensions)
    return lambda points: np.ceil(4 * np.maximum(np.asarray(smooth(points)), 0)) / 4


def rare_events() -> Iterator[Case]:
    """Subset simulation against limits of exactly known probability."""
    for truth in (1e-3, 1e-5):
        for limit, dimensions in ((plane, 10), (plane, 100), (ball, 10), (steps, 20)):
            of = f"{truth:g}, {limit.__name__}, {dimensions} dimensions"
            study = partial(rare_event, limit(truth, dimensions), dimensions)
            yield Case("subset simulation", of, truth, study, rare=True)


def rare_event(limit: Limit, dimensions: int, seed: int) -> Estimate:
    """One estimate."""
    return subset_simulation(limit, dimensions, seed).estimate


def cases() -> Iterator[Case]:
    """All of them."""
    yield from probabilities()
    yield from values()
    yield from factors()
    yield from rare_events()
