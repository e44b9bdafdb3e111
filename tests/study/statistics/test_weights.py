"""Weighted runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.errors import ArgumentError
from fleet.study.statistics.proportions import proportion
from fleet.study.statistics.weights import (
    effective_runs,
    weighted_proportion,
    weighted_risk_ratio,
)


@given(st.integers(1, 9), st.floats(1e-3, 1e3))
def test_equal_weights_are_no_weights(events: int, weight: float) -> None:
    """But for the variance, which is estimated of one run fewer."""
    happened = np.arange(200) < events
    found = weighted_proportion(happened, np.full(200, weight))
    plain = proportion(events, 200)
    assert found.effective_runs == pytest.approx(200)
    assert found.effective_events == pytest.approx(events)
    assert found.estimate.value == pytest.approx(plain.value)
    assert found.estimate.low == pytest.approx(plain.low, rel=0.02)
    assert found.estimate.high == pytest.approx(plain.high, rel=0.02)


def test_kish_counts_what_weights_are_worth() -> None:
    assert effective_runs([1.0, 1.0, 2.0]) == pytest.approx(16 / 6)
    assert effective_runs([1.0] * 50 + [1e-9] * 50) == pytest.approx(50)


def test_the_value_is_the_weighted_share() -> None:
    found = weighted_proportion([True, False, True, False], [1.0, 2.0, 3.0, 4.0])
    assert found.estimate.value == pytest.approx(0.4)
    assert found.effective_events == pytest.approx(16 / 10)


def test_without_an_event_the_bound_is_that_of_the_effective_runs() -> None:
    weights = np.array([1.0] * 30 + [10.0] * 5)
    found = weighted_proportion(np.zeros(35, dtype=bool), weights)
    assert found.estimate.high == pytest.approx(1 - 0.025 ** (1 / effective_runs(weights)))
    assert found.estimate.value == found.estimate.low == found.effective_events == 0.0
    every = weighted_proportion(np.ones(35, dtype=bool), weights).estimate
    assert (every.value, every.high) == (1.0, 1.0)


def test_encounters_that_are_drawn_near_the_zone_are_worth_more_than_they_are() -> None:
    """Miss distances drawn near 0 and weighted by the uniform density: covers, and is narrower."""
    rng, covered, widths = np.random.default_rng(2), 0, []
    chance = 0.5 * math.sqrt(math.pi) / 2 * math.erf(10.0) / 10  # of 0.5 exp(-d^2), d from 0 to 10
    for _ in range(300):
        near = -np.log(1 - rng.random(400) * (1 - math.exp(-10)))
        miss = np.where(rng.random(400) < 0.2, 10 * rng.random(400), near)
        density = 0.2 * 0.1 + 0.8 * np.exp(-miss) / (1 - math.exp(-10))
        lost = rng.random(400) < 0.5 * np.exp(-miss * miss)
        found = weighted_proportion(lost, 0.1 / density).estimate
        covered += found.covers(chance)
        widths.append(found.half_width)
    assert 0.92 < covered / 300 <= 0.99
    assert np.mean(widths) < 0.75 * proportion(round(400 * chance), 400).half_width


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.inf, math.nan])
def test_weights_that_are_none_are_refused(wrong: float) -> None:
    with pytest.raises(ArgumentError, match="weights: 1 of 3 are"):
        weighted_proportion([True, False, True], [1.0, wrong, 1.0])
    with pytest.raises(ArgumentError, match="not 2 of 3 runs"):
        weighted_proportion([True, False, True], [1.0, 1.0])


def test_the_weighted_risk_ratio_covers_what_avoidance_leaves() -> None:
    """Danger below 1 of 10, drawn near 0; avoidance leaves two in five, the more the nearer."""
    covered, (miss_at, step) = 0, (np.linspace(0.0, 10.0, 100_001), 1e-4)
    danger = 0.5 * np.exp(-miss_at * miss_at)
    ratio = float((danger * 0.8 * np.exp(-miss_at)).sum() * step / (danger.sum() * step))
    rng = np.random.default_rng(4)
    for _ in range(200):
        near = -np.log(1 - rng.random(400) * (1 - math.exp(-10)))
        miss = np.where(rng.random(400) < 0.2, 10 * rng.random(400), near)
        density = 0.2 * 0.1 + 0.8 * np.exp(-miss) / (1 - math.exp(-10))
        lost = rng.random(400) < 0.5 * np.exp(-miss * miss)
        with_avoidance = lost & (rng.random(400) < 0.8 * np.exp(-miss))
        covered += weighted_risk_ratio(with_avoidance, lost, 0.1 / density).covers(ratio)
    assert covered >= 190


def test_the_weighted_risk_ratio_is_that_of_weighted_shares() -> None:
    lost, weights = [True, True, True, False], [1.0, 2.0, 3.0, 4.0]
    found = weighted_risk_ratio([True, False, False, True], lost, weights)
    assert found.value == pytest.approx(5.0 / 6.0)
    assert found.low < found.value < found.high
    nobody = [False] * 4
    assert weighted_risk_ratio(nobody, lost, weights).value == 0.0
    assert weighted_risk_ratio(lost, nobody, weights).high == math.inf
    assert math.isnan(weighted_risk_ratio(nobody, nobody, weights).value)
