"""Survival curves and their bands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.errors import ArgumentError
from fleet.study.statistics.proportions import proportion
from fleet.study.statistics.survival import survival_of


def test_a_curve_counts_who_keeps_at_least_so_much() -> None:
    curve = survival_of([0.5, 1.0, 1.0, math.inf])
    assert curve.at.tolist() == [0.5, 1.0, math.inf]
    assert curve.share.tolist() == [1.0, 0.75, 0.25]
    assert survival_of([0.5, 1.0, 1.0, 2.0], at=[0.0, 1.0, 1.01]).share.tolist() == [1, 0.75, 0.25]


def test_the_simultaneous_band_is_that_of_kolmogorov() -> None:
    """Critical values of tables (Massey 1951): 0.294 for 20 runs, 1.36 / sqrt(n) for many."""
    values = np.arange(20.0)
    curve = survival_of(values)
    assert curve.share[10] - curve.low[10] == pytest.approx(0.294, abs=5e-4)
    many = survival_of(np.arange(10_000.0), at=[5000.0])
    assert many.high[0] - many.share[0] == pytest.approx(0.01358, abs=1e-4)
    massart = math.sqrt(math.log(2 / 0.05) / 2 / 10_000)
    assert many.high[0] - many.share[0] < massart
    assert curve.low.min() == 0.0
    assert curve.high.max() == 1.0


def test_pointwise_bounds_are_those_of_the_counts() -> None:
    values = np.arange(30.0)
    curve = survival_of(values, at=[-1.0, 3.0, 99.0], band="pointwise")
    for k, kept in enumerate((30, 27, 0)):
        alone = proportion(kept, 30)
        assert (curve.low[k], curve.high[k]) == pytest.approx((alone.low, alone.high))


def test_the_whole_curve_is_in_the_band_as_often_as_it_should() -> None:
    rng, inside = np.random.default_rng(11), 0
    for _ in range(400):
        curve = survival_of(rng.random(60))
        # between two values the curve is that of the one above, and its truth 1 - x
        below = np.concatenate([[0.0], curve.at[:-1]])
        inside += bool((curve.low <= 1 - curve.at).all() and (curve.high >= 1 - below).all())
    assert 0.92 < inside / 400 < 0.98


def test_what_is_no_outcome_is_told() -> None:
    with pytest.raises(ArgumentError, match="nan"):
        survival_of([1.0, math.nan])
    with pytest.raises(ArgumentError, match="simultaneous or pointwise"):
        survival_of([1.0], band="both")  # type: ignore[arg-type]
