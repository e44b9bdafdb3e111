"""Separation of all pairs, against loops over pairs and moments."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis.separation import SeparationMonitor
from fleet.model.conflict.risk import Required

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


def between(a: Point, b: Point, fraction: float) -> Point:
    """A point of a straight line."""
    north, east, down = (x + fraction * (y - x) for x, y in zip(a, b, strict=True))
    return north, east, down


def relative(moment: list[Point], i: int, j: int) -> Point:
    north, east, down = (x - y for x, y in zip(moment[i], moment[j], strict=True))
    return north, east, down


ORIGIN = (0.0, 0.0, 0.0)


def least_on_the_way(a: Point, b: Point) -> float:
    """Least normalised separation on a line, which is convex along it: by ternary search."""
    low, high = 0.0, 1.0
    for _ in range(120):
        one, two = low + (high - low) / 3.0, high - (high - low) / 3.0
        if apart(between(a, b, one), ORIGIN)[0] <= apart(between(a, b, two), ORIGIN)[0]:
            high = two
        else:
            low = one
    ends = apart(a, ORIGIN)[0], apart(b, ORIGIN)[0]
    return min(apart(between(a, b, low), ORIGIN)[0], *ends)


@given(st.integers(2, 5).flatmap(flights))
@fast
def test_the_minimum_of_each_pair_is_that_of_the_whole_way(moments: list[list[Point]]) -> None:
    ids = [10 * (n + 1) for n in range(len(moments[0]))]
    monitor = monitored(ids, moments)
    found = {(m.a, m.b): m for m in monitor.minima()}
    pairs = list(itertools.combinations(range(len(ids)), 2))
    assert set(found) == {(ids[i], ids[j]) for i, j in pairs}
    for i, j in pairs:
        way = [relative(m, i, j) for m in moments]
        legs = list(itertools.pairwise(way)) or [(way[0], way[0])]
        minimum = found[ids[i], ids[j]]
        least = min(least_on_the_way(a, b) for a, b in legs)
        assert minimum.least_separation == pytest.approx(least, abs=1e-9)
        before = min(int(minimum.t_s / 0.1 + 1e-6), len(legs) - 1)
        there = between(*legs[before], minimum.t_s / 0.1 - before)
        expected = (minimum.least_separation, minimum.horizontal_m, minimum.vertical_m)
        # the time is told in whole ns, in which a leg of 0.1 s is flown on by so much at most
        by_rounding_m = 0.5e-8 * math.dist(*legs[before]) + 1e-9
        assert apart(there, ORIGIN) == pytest.approx(expected, abs=by_rounding_m)
        earlier = [least_on_the_way(a, b) for a, b in legs[:before]]
        assert all(value > least - 1e-9 for value in earlier)
    assert monitor.least() == min(m.least_separation for m in found.values())
    assert monitor.pairs_lost() == sum(m.lost for m in found.values())
    assert monitor.lost() == (monitor.pairs_lost() > 0)


@pytest.mark.parametrize(
    ("offset_m", "radius_m", "least"), [(0.0, 1.0, 0.0), (4.0, 2.5, 0.8), (5.0, 2.5, 1.0)]
)
def test_two_that_pass_between_two_ticks_are_as_near_as_they_then_are(
    offset_m: float, radius_m: float, least: float
) -> None:
    # 50 m/s closing, 2.4 m apart at the tick before: they pass 48 ms later.
    monitor = SeparationMonitor([1, 2], Required(2.0 * radius_m, 50.0))
    for tick in range(3):
        gap_m = 2.4 + 5.0 - 5.0 * tick
        monitor.update(tick * 100_000_000, np.array([(0.0, 0.0, 0.0), (offset_m, gap_m, 0.0)]))
    (minimum,) = monitor.minima()
    assert minimum.least_separation == pytest.approx(least, abs=1e-12)
    assert (minimum.horizontal_m, minimum.t_s) == pytest.approx((offset_m, 0.148), abs=1e-9)
    assert monitor.lost() is (offset_m < 2.0 * radius_m)


def test_those_that_keep_exactly_what_is_required_do_not_lose_it_by_rounding() -> None:
    rows = [[(2.5 * n, 0.0, 0.0), (2.5 * n, 400.0, 0.0), (2.5 * n, 0.0, 50.0)] for n in range(200)]
    monitor = monitored([1, 2, 3], rows)
    assert (monitor.least(), monitor.pairs_lost()) == (1.0, 0)


def test_who_is_not_there_is_near_nobody() -> None:
    nowhere = (math.nan, math.nan, math.nan)
    there = [(900.0, 0.0, 0.0), (600.0, 0.0, 0.0), nowhere, (-600.0, 0.0, 0.0)]
    monitor = monitored([1, 2], [[(0.0, 0.0, 0.0), place] for place in there])
    assert monitor.least() == 1.5


@given(flights(4))
@fast
def test_the_nearest_pair_comes_first(moments: list[list[Point]]) -> None:
    values = [m.least_separation for m in monitored([1, 2, 3, 4], moments).minima()]
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


@fast
@given(flights(3), st.sets(st.tuples(st.integers(0, 5), st.integers(0, 2))))
def test_asking_after_every_moment_changes_nothing(
    moments: list[list[Point]], absent: set[tuple[int, int]]
) -> None:
    gone = (math.nan, math.nan, math.nan)
    flown = [
        [gone if (n, uav) in absent else place for uav, place in enumerate(moment)]
        for n, moment in enumerate(moments)
    ]
    asked = SeparationMonitor([1, 2, 3], REQUIRED)
    for tick, positions in enumerate(flown):
        asked.update(tick * 100_000_000, np.array(positions))
        asked.least()
    at_once = monitored([1, 2, 3], flown)
    assert at_once.minima() == asked.minima()
    assert at_once.now() == asked.now()
