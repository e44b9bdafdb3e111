"""Means and quantiles: exact by order, and bootstrapped by run."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from fleet.errors import ArgumentError
from fleet.study.statistics.quantiles import mean_by_run, quantile_by_order, quantile_by_run


@given(st.integers(1, 120), st.sampled_from([0.05, 0.5, 0.9]))
def test_order_statistics_miss_on_neither_side_more_often_than_they_may(
    runs: int, share: float
) -> None:
    """With values 1 to n, bounds are ranks; how often they miss is a binomial probability."""
    found = quantile_by_order(np.arange(1, runs + 1), share)
    if found.low > -math.inf:  # below the quantile unless fewer than `low` runs are
        assert binom.cdf(found.low - 1, runs, share) <= 0.025
    if found.high < math.inf:  # above it unless `high` runs or more are below
        assert binom.sf(found.high - 1, runs, share) <= 0.025
    assert found.low <= found.value <= found.high


def test_order_statistics_are_those_of_the_textbook() -> None:
    """Conover, section 3.2: the upper quartile of 16 radio tubes lies between ranks 9 and 16."""
    found = quantile_by_order(np.arange(1, 17), 0.75, level=0.9)
    assert binom.cdf(8, 16, 0.75) + binom.sf(15, 16, 0.75) < 0.1
    assert (found.low, found.high) == (9, 16)


def test_few_runs_have_no_bound_and_infinite_values_are_values() -> None:
    few = quantile_by_order([1.0, 2.0, 3.0], 0.5)
    assert (few.value, few.low, few.high) == (2.0, -math.inf, math.inf)
    alone = quantile_by_order([math.inf] * 30 + [1.0] * 10, 0.5)
    assert (alone.value, alone.low) == (math.inf, math.inf)
    with pytest.raises(ArgumentError, match="1 of 3 are nan"):
        quantile_by_order([1.0, math.nan, 2.0], 0.5)
    with pytest.raises(ArgumentError, match="share between 0 and 1, not 2"):
        quantile_by_order([1.0], 2)


def pairs_of_runs(runs: int, seed: int = 3) -> list[np.ndarray]:
    """Values of 1 to 8 pairs a run that are nearly alike within a run."""
    rng = np.random.default_rng(seed)
    return [rng.normal() + 0.01 * rng.normal(size=size) for size in rng.integers(1, 9, size=runs)]


def test_a_run_counts_once_however_many_pairs_it_has() -> None:
    """As wide as for the runs there are (about 2 x 1.96 / sqrt(60)), not for all of their pairs."""
    runs = pairs_of_runs(60)
    by_run = mean_by_run(runs, seed=1)
    by_pair = mean_by_run([*np.concatenate(runs)[:, None]], seed=1)
    assert by_run.value == by_pair.value == pytest.approx(np.concatenate(runs).mean())
    assert by_run.half_width > 1.8 * by_pair.half_width
    assert (by_run.runs, by_pair.runs) == (60, sum(map(len, runs)))
    median, of_pairs = (
        quantile_by_run(r, 0.5, seed=1) for r in (runs, [*np.concatenate(runs)[:, None]])
    )
    assert median.half_width > 1.5 * of_pairs.half_width


def test_runs_are_drawn_again_with_all_of_their_values() -> None:
    """Intervals are as of runs drawn again one by one, and as of the variance of a ratio."""
    rng, medians = np.random.default_rng(1), []
    runs = [10 + run + 2 * rng.normal(size=len(run)) for run in pairs_of_runs(40, seed=9)]
    for _ in range(2000):
        drawn = [runs[k] for k in rng.integers(40, size=40)]
        medians.append(np.quantile(np.concatenate(drawn), 0.5, method="inverted_cdf"))
    low, high = np.quantile(medians, [0.025, 0.975])
    found = quantile_by_run(runs, 0.5, seed=4)
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.1 * (high - low))
    mean = mean_by_run(runs, seed=4)
    of_runs = [float((run - mean.value).sum()) for run in runs]
    reach = 1.96 * math.sqrt(sum(x * x for x in of_runs)) / sum(map(len, runs))
    assert mean.half_width == pytest.approx(reach, rel=0.1)


def test_the_bootstrap_agrees_with_the_theory_of_a_mean() -> None:
    values = np.random.default_rng(5).normal(10.0, 2.0, size=400)
    found = mean_by_run([*values[:, None]], seed=2)
    reach = 1.96 * values.std(ddof=1) / 20
    assert found.low == pytest.approx(values.mean() - reach, abs=0.03)
    assert found.high == pytest.approx(values.mean() + reach, abs=0.03)
    assert quantile_by_run([*values[:, None]], 0.9, seed=2).value == np.quantile(
        values, 0.9, method="inverted_cdf"
    )


def test_the_same_seed_draws_the_same_and_runs_without_values_change_nothing() -> None:
    runs = pairs_of_runs(30)
    assert mean_by_run(runs, seed=7) == mean_by_run([*runs, []], seed=7)
    assert mean_by_run(runs, seed=7) != mean_by_run(runs, seed=8)
    assert quantile_by_run(runs, 0.3, seed=7) == quantile_by_run([[], *runs], 0.3, seed=7)


def test_runs_that_do_not_differ_bound_no_mean() -> None:
    alike = mean_by_run([[1.0, 3.0]] * 9, seed=1)
    assert (alike.value, alike.low, alike.high) == (2.0, -math.inf, math.inf)
    alone = quantile_by_run([[1.0, 3.0]], 0.5, seed=1)
    assert (alone.value, alone.low, alone.high) == (1.0, -math.inf, math.inf)
    assert quantile_by_run([[2.0]] * 9, 0.5, seed=1).low == 2.0
    with pytest.raises(ArgumentError, match="no run has one"):
        mean_by_run([[], []], seed=1)
    with pytest.raises(ArgumentError, match="1 of 2 are inf"):
        mean_by_run([[1.0], [math.inf]], seed=1)
