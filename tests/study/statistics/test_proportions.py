"""Probabilities from counts."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from fleet.errors import ArgumentError
from fleet.study.statistics.estimate import Estimate
from fleet.study.statistics.proportions import proportion, runs_needed


def bounds(estimate: Estimate) -> tuple[float, float]:
    return round(estimate.low, 4), round(estimate.high, 4)


@pytest.mark.parametrize(
    ("events", "runs", "method", "expected"),
    [
        (0, 3, "exact", (0.0, 0.7076)),  # 1 - 0.025^(1/3)
        (13, 16, "exact", (0.5435, 0.9595)),  # Fagerland, Lydersen and Laake, table 2.8
        (10, 10, "exact", (0.6915, 1.0)),
        (15, 148, "wilson", (0.0624, 0.1605)),  # Newcombe 1998, table I, method 3
        (0, 20, "wilson", (0.0, 0.1611)),
        (1, 29, "wilson", (0.0061, 0.1718)),
        (81, 263, "wilson", (0.2553, 0.3662)),
        (81, 263, "exact", (0.2527, 0.3676)),  # Newcombe 1998, table I, method 5
    ],
)
def test_intervals_are_those_of_the_textbooks(
    events: int, runs: int, method: str, expected: tuple[float, float]
) -> None:
    assert bounds(proportion(events, runs, method=method)) == expected  # type: ignore[arg-type]


@given(st.integers(1, 400), st.data())
def test_exact_bounds_are_where_the_count_is_just_believable(
    runs: int, data: st.DataObject
) -> None:
    events = data.draw(st.integers(0, runs))
    found = proportion(events, runs, level=0.9)
    if events:
        assert binom.sf(events - 1, runs, found.low) == pytest.approx(0.05, rel=1e-6)
    if events < runs:
        assert binom.cdf(events, runs, found.high) == pytest.approx(0.05, rel=1e-6)
    assert found.covers(found.value)


def test_exact_covers_its_level_whatever_the_probability() -> None:
    """The coverage itself, summed over all counts: not a simulation."""
    runs = 40
    found = [proportion(k, runs) for k in range(runs + 1)]
    for percent in range(1, 100):
        chances = binom.pmf(range(runs + 1), runs, percent / 100)
        covers = [estimate.covers(percent / 100) for estimate in found]
        assert sum(chances[covers]) >= 0.95


@pytest.mark.parametrize("method", ["exact", "wilson"])
@pytest.mark.parametrize("half_width", [0.1, 0.02])
def test_as_many_runs_as_needed_are_enough_and_one_fewer_is_not(
    method: str, half_width: float
) -> None:
    runs = runs_needed(half_width, method=method)  # type: ignore[arg-type]
    even = runs + runs % 2
    assert proportion(even // 2, even, method=method).half_width <= half_width  # type: ignore[arg-type]
    few = runs - 2 + runs % 2
    assert proportion(few // 2, few, method=method).half_width > half_width  # type: ignore[arg-type]


def test_what_never_happens_needs_few_runs() -> None:
    assert runs_needed(0.005, expected=0.0) == 368  # log 0.025 / log 0.99 = 367.04
    assert runs_needed(0.005) > 38_000


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: proportion(4, 3), "not 4 of 3"),
        (lambda: proportion(0, 0), "at least one run"),
        (lambda: proportion(1, 3, level=1.0), "a share between 0 and 1, as 0.95"),
        (lambda: proportion(1, 3, method="wald"), "exact, wilson, not 'wald'"),  # type: ignore[arg-type]
        (lambda: runs_needed(0.0), "a half-width"),
        (lambda: runs_needed(1e-9), "more than"),
    ],
)
def test_what_is_impossible_is_told(call: object, words: str) -> None:
    assert callable(call)
    with pytest.raises(ArgumentError, match=words):
        call()
