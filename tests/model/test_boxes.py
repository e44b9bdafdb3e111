"""Boxes that overlap: the same pairs as by looking at all of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model.conflict.boxes import FEW, overlapping

SETTINGS = settings(deadline=None, derandomize=True, max_examples=60)


def by_all_pairs(low: np.ndarray, high: np.ndarray) -> list[tuple[int, int]]:
    """One by one."""
    count = len(low)
    return [
        (i, j)
        for i in range(count)
        for j in range(i + 1, count)
        if (low[i] < high[j]).all() and (low[j] < high[i]).all()
    ]


def as_list(pairs: tuple[np.ndarray, np.ndarray]) -> list[tuple[int, int]]:
    return list(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True))


@given(
    seed=st.integers(0, 2**32),
    count=st.one_of(st.integers(0, 8), st.integers(FEW - 1, FEW + 60)),
    spread=st.sampled_from([0.0, 5.0, 300.0, 1e5]),
    largest=st.sampled_from([1e-3, 3.0, 60.0]),
)
@SETTINGS
def test_the_pairs_are_those_that_overlap_on_every_axis(
    seed: int, count: int, spread: float, largest: float
) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform(-spread, spread, (count, 3)).round(1)
    high = low + rng.uniform(0.0, largest, (count, 3)).round(3)
    assert as_list(overlapping(low, high)) == by_all_pairs(low, high)


@pytest.mark.parametrize("count", [5, FEW + 10])
def test_a_row_of_boxes_meets_its_neighbours_alone(count: int) -> None:
    """Each reaches 1.5 of the way to the next but one; they are given in a shuffled order."""
    place = np.random.default_rng(1).permutation(count).astype(float)
    low = np.stack([place, np.zeros(count), np.zeros(count)], axis=1)
    met = {frozenset(pair) for pair in as_list(overlapping(low, low + np.array((1.5, 1.0, 1.0))))}
    order = np.argsort(place)
    assert met == {frozenset(map(int, order[k : k + 2])) for k in range(count - 1)}


def test_boxes_that_only_touch_do_not_overlap() -> None:
    low = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert as_list(overlapping(low, low + 1.0)) == []


def test_one_far_away_costs_nothing_but_its_row() -> None:
    low = np.zeros((FEW + 5, 3))
    low[:, 0] = np.arange(FEW + 5) * 10.0
    low[0] = (1e7, -1e7, 0.0)
    assert as_list(overlapping(low, low + 1.0)) == []
