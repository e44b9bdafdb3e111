"""Stopping when enough is known, with intervals that stay valid however often one looks."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from fleet.errors import ArgumentError
from fleet.study.statistics.estimate import Estimate
from fleet.study.statistics.proportions import proportion, runs_needed
from fleet.study.statistics.stopping import StoppingRule

RULE = StoppingRule(half_width=0.05, most_runs=100_000)


@lru_cache(maxsize=100_000)
def bounds(events: int, runs: int, half_width: float = 0.05) -> tuple[float, float]:
    found = StoppingRule(half_width, 100_000).estimate(events, runs)
    return found.low, found.high


@lru_cache(maxsize=100_000)
def exact(events: int, runs: int) -> Estimate:
    return proportion(events, runs)


def mean_by_likelihood(share: float, events: int, runs: int) -> float:
    """What a truth has to keep below 20, integrated numerically."""
    worth = 0.1 / 0.05**2
    one, other = worth * share, worth * (1 - share)
    scale = math.lgamma(one + other) - math.lgamma(one) - math.lgamma(other)
    own = events * math.log(share) + (runs - events) * math.log(1 - share)

    def density(x: float) -> float:
        power = (one - 1 + events) * math.log(x) + (other - 1 + runs - events) * math.log(1 - x)
        return math.exp(scale + power - own)

    return float(quad(density, 0, 1, limit=200)[0])


@pytest.mark.parametrize(("events", "runs"), [(10, 50), (40, 80), (90, 100)])
def test_at_its_bounds_a_share_is_just_believable(events: int, runs: int) -> None:
    for bound in bounds(events, runs):
        assert mean_by_likelihood(bound, events, runs) == pytest.approx(20, rel=1e-5)


@given(st.integers(1, 2000), st.data())
@settings(max_examples=50)
def test_no_share_outside_the_bounds_is_believable(runs: int, data: st.DataObject) -> None:
    events = data.draw(st.integers(0, runs))
    low, high = bounds(events, runs)
    assert low <= events / runs <= high
    outside = [*np.geomspace(1e-9, low, 30)[:-1]] if low > 1e-9 else []
    outside += [1 - x for x in np.geomspace(1e-9, 1 - high, 30)[:-1]] if high < 1 - 1e-9 else []
    assert all(RULE._log_ratio(share, events, runs) > 0 for share in outside)


@pytest.mark.parametrize("truth", [0.02, 0.3])
def test_who_looks_after_each_run_and_stops_at_the_worst_is_misled_seldom(truth: float) -> None:
    """A study of 200 runs is looked at 200 times, and missed if one of the intervals misses."""
    rng, missed_ever, missed_fixed = np.random.default_rng(4), 0, 0
    studies = 250
    for _ in range(studies):
        counts = np.cumsum(rng.random(200) < truth)
        looks = np.arange(1, 201)
        found = [bounds(int(k), int(n)) for k, n in zip(counts, looks, strict=True)]
        missed_ever += any(not low <= truth <= high for low, high in found)
        plain = [exact(int(k), int(n)) for k, n in zip(counts, looks, strict=True)]
        missed_fixed += any(not estimate.covers(truth) for estimate in plain)
    assert missed_ever / studies <= 0.05
    assert missed_fixed / studies > 0.07  # what the rule is for


def test_a_study_stops_when_it_is_narrow_enough_or_has_flown_all() -> None:
    rng, runs, events = np.random.default_rng(1), 0, 0
    while not RULE.enough(events, runs):
        runs += 20
        events += int(rng.binomial(20, 0.1))
    found = RULE.estimate(events, runs)
    assert found.half_width <= 0.05
    assert runs < RULE.runs_expected(0.5)
    assert not RULE.enough(events=0, runs=0)
    assert StoppingRule(0.01, most_runs=40).enough(events=1, runs=40)
    assert not StoppingRule(0.01, most_runs=40).enough(events=1, runs=39)


@pytest.mark.parametrize("expected", [0.5, 0.2, 0.05])
def test_what_peeking_costs(expected: float) -> None:
    rule = StoppingRule(0.02, most_runs=10**9)
    cost = rule.runs_expected(expected) / runs_needed(0.02, expected)
    assert 2.0 < cost < 2.6
    assert StoppingRule(0.02, most_runs=100).runs_expected(expected) == 100


def test_a_rule_that_cannot_be_kept_is_refused() -> None:
    for half_width, most in ((0.0, 10), (1.0, 10), (0.1, 0)):
        with pytest.raises(ArgumentError, match="a half-width between 0 and 1"):
            StoppingRule(half_width, most)
    with pytest.raises(ArgumentError, match="not 3 of 2"):
        RULE.estimate(3, 2)
