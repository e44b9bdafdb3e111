"""Separation of all pairs, against loops over pairs and moments."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis.separation import SeparationMonitor
from fleet.model.risk import Required

REQUIRED = Required(400.0, 50.0)
fast = settings(deadline=None, derandomize=True, max_examples=100)
Point = tuple[float, float, float]

metres = st.integers(-1000, 1000).map(float)
points = st.tuples(metres, metres, st.integers(-100, 100).map(float))


def flights(ids: int) -> st.SearchStrategy[list[list[Point]]]:
    """Positions of so many UAVs at several moments."""
    return st.lists(st.lists(points, min_size=ids, max_size=ids), min_size=1, max_size=6)


def monitored(ids: list[int], moments: list[list[Point]]) -> SeparationMonitor:
    monitor = SeparationMonitor(ids, REQUIRED)
    for tick, positions in enumerate(moments):
        monitor.update(tick * 100_000_000, np.array(positions))
    return monitor


def apart(a: Point, b: Point) -> tuple[float, float, float]:
    """Normalised separation, and the two distances."""
    level = math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)
    height = abs(a[2] - b[2])
    return max(level / 400.0, height / 50.0), level, height


@given(st.integers(2, 5).flatmap(flights))
@fast
def test_the_minimum_of_each_pair_is_that_of_all_moments(moments: list[list[Point]]) -> None:
    ids = [10 * (n + 1) for n in range(len(moments[0]))]
    monitor = monitored(ids, moments)
    pairs = list(itertools.combinations(range(len(ids)), 2))
    least = {(i, j): min(apart(m[i], m[j])[0] for m in moments) for i, j in pairs}
    found = {(m.a, m.b): m for m in monitor.minima()}
    assert set(found) == {(ids[i], ids[j]) for i, j in pairs}
    for (i, j), value in least.items():
        minimum = found[ids[i], ids[j]]
        when = round(minimum.t_s / 0.1)
        assert minimum.normalised == pytest.approx(value)
        there = apart(moments[when][i], moments[when][j])
        assert there == pytest.approx(
            (minimum.normalised, minimum.horizontal_m, minimum.vertical_m)
        )
        earlier = [apart(m[i], m[j])[0] for m in moments[:when]]
        assert all(e > value - 1e-9 for e in earlier)
    assert monitor.least() == pytest.approx(min(least.values()))
    assert monitor.lost() == any(
        apart(m[i], m[j])[1] < 400.0 and apart(m[i], m[j])[2] < 50.0
        for m in moments
        for i, j in pairs
    )


@given(flights(4))
@fast
def test_the_nearest_pair_comes_first(moments: list[list[Point]]) -> None:
    values = [m.normalised for m in monitored([1, 2, 3, 4], moments).minima()]
    assert len(values) == 6
    assert values == sorted(values)


@pytest.mark.parametrize(
    ("other", "value", "lost"),
    [
        ((400.0, 0.0, 0.0), 1.0, False),
        ((399.0, 0.0, 49.0), 0.9975, True),
        ((0.0, 0.0, 50.0), 1.0, False),
        ((0.0, 0.0, -49.0), 0.98, True),
        ((240.0, -320.0, 0.0), 1.0, False),
        ((300.0, 300.0, 0.0), 1.0606601717798212, False),
        ((0.0, 0.0, 0.0), 0.0, True),
    ],
)
def test_separation_is_lost_when_both_distances_are_too_small(
    other: Point, value: float, lost: bool
) -> None:
    monitor = monitored([1, 2], [[(0.0, 0.0, 0.0), other]])
    assert monitor.least() == pytest.approx(value)
    assert monitor.lost() is lost


def test_a_loss_is_not_forgotten_when_the_pair_separates() -> None:
    monitor = monitored([1, 2], [[(0.0, 0.0, 0.0), (x, 0.0, 0.0)] for x in (900.0, 300.0, 900.0)])
    assert monitor.lost()
    (minimum,) = monitor.minima()
    assert (minimum.t_s, minimum.horizontal_m, minimum.vertical_m) == (0.1, 300.0, 0.0)


def test_the_first_of_equal_moments_is_kept() -> None:
    monitor = monitored([1, 2], 3 * [[(0.0, 0.0, 0.0), (500.0, 0.0, 0.0)]])
    assert monitor.minima()[0].t_s == 0.0


@pytest.mark.parametrize("ids", [[], [1]])
def test_fewer_than_two_uavs_are_never_too_close(ids: list[int]) -> None:
    monitor = monitored(ids, [[(0.0, 0.0, 0.0)] * len(ids)])
    assert (monitor.least(), monitor.lost(), monitor.minima()) == (math.inf, False, [])


def test_nothing_seen_is_no_minimum() -> None:
    monitor = SeparationMonitor([1, 2], REQUIRED)
    assert (monitor.least(), monitor.lost(), monitor.minima()) == (math.inf, False, [])
