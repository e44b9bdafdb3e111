"""Radio range: the grid finds the pairs that looking at each one finds, and ears go with UAVs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.model import radio
from fleet.model.radio import Ear, Earshot, RadioRange, pairs_within, within
from fleet.model.types import COORDINATOR, Array, Indices, Position

NOWHERE = (math.nan, math.nan, math.nan)
ON_A_LINE = [(0.0, float(east), -300.0) for east in range(0, 5000, 1000)]

coordinates = st.one_of(
    st.floats(-3000.0, 3000.0), st.floats(-1e7, 1e7), st.integers(-20, 20).map(lambda n: 250.0 * n)
)
points = st.lists(
    st.one_of(st.tuples(coordinates, coordinates, coordinates), st.just(NOWHERE)), max_size=30
)


def rows(places: list[Position]) -> Array:
    return np.array(places, dtype=np.float64).reshape(-1, 3)


def brute(there: list[Position], here: list[Position], range_m: float) -> list[tuple[int, int]]:
    return [
        (i, j)
        for i, one in enumerate(there)
        for j, other in enumerate(here)
        if within(one, other, range_m)
    ]


@given(points, points, st.sampled_from([1e-3, 1.0, 250.0, 500.0, 1234.5, 1e5, 1e8]))
def test_the_grid_finds_the_pairs_that_comparing_all_finds(
    there: list[Position], here: list[Position], range_m: float
) -> None:
    wanted = brute(there, here, range_m)
    for few in (radio.FEW_LINKS, 0):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(radio, "FEW_LINKS", few)
            first, second = pairs_within(rows(there), rows(here), range_m)
        assert list(zip(first.tolist(), second.tolist(), strict=True)) == wanted


def test_the_grid_compares_neighbours_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[int] = []
    spans = radio._spans

    def counted(begin: Indices, end: Indices) -> tuple[Indices, Indices]:
        compared.append(int((end - begin).sum()))
        return spans(begin, end)

    monkeypatch.setattr(radio, "_spans", counted)
    side = np.arange(40) * 1000.0
    places = np.array([(n, e, 0.0) for n in side for e in side])
    first, _ = pairs_within(places, places, 1000.0)
    inside = 40 * 40 * 5 - 4 * 40  # itself and four neighbours, but for the edges
    assert (len(first), sum(compared) <= 9 * len(places)) == (inside, True)


def test_the_range_itself_is_within_range_and_height_counts() -> None:
    assert within((0.0, 300.0, -400.0), (0.0, 0.0, 0.0), 500.0)
    assert not within((0.0, 300.0, -400.1), (0.0, 0.0, 0.0), 500.0)


def test_each_link_has_its_own_range() -> None:
    reach = RadioRange(uavs_m=1000.0, coordinator_m=2500.0)
    places = {COORDINATOR: (0.0, 0.0, 0.0), **dict(enumerate(ON_A_LINE, start=1))}
    places[COORDINATOR] = ON_A_LINE[0]
    earshot = Earshot(reach, places, places)
    assert [sorted(earshot.hearers(n)) for n in range(6)] == [
        [1, 2, 3],
        [0, 2],
        [0, 1, 3],
        [0, 2, 4],
        [3, 5],
        [4],
    ]
    assert (earshot.hears(4, 4), earshot.hears(1, 5), earshot.hears(1, 9)) == (True, False, False)


@pytest.mark.parametrize(
    ("reach", "hears_far", "hears_coordinator"),
    [
        (RadioRange(), True, True),
        (RadioRange(uavs_m=1.0), False, True),
        (RadioRange(coordinator_m=1.0), True, False),
    ],
)
def test_a_range_that_is_not_given_is_no_limit(
    reach: RadioRange, hears_far: bool, hears_coordinator: bool
) -> None:
    far = (1e6, 0.0, 0.0)
    assert reach.limited == (not hears_far or not hears_coordinator)
    assert reach.reaches(1, 2, far, ON_A_LINE[0]) == hears_far
    assert reach.reaches(COORDINATOR, 2, far, ON_A_LINE[0]) == hears_coordinator
    assert reach.reaches(2, COORDINATOR, far, ON_A_LINE[0]) == hears_coordinator
    assert reach.reaches(2, 2, None, ON_A_LINE[0])
    assert reach.reaches(1, 2, None, ON_A_LINE[0]) == hears_far


def test_who_is_not_there_neither_hears_nor_is_compared() -> None:
    reach = RadioRange(uavs_m=1500.0)
    earshot = Earshot(reach, {1: ON_A_LINE[0]}, {1: ON_A_LINE[0], 2: ON_A_LINE[1], 3: NOWHERE})
    assert earshot.hearers(1) == [2]


def test_an_ear_goes_with_its_uav_and_for_a_tick_stays_where_it_was_after_a_leap() -> None:
    ear = Ear((0.0, 0.0, 0.0))
    ear.move((2.5, 0.0, 0.0), 50.0)
    assert ear.place == (2.5, 0.0, 0.0)
    ear.move((202.5, 0.0, 0.0), 50.0)  # it has been stopped for 8 s
    assert ear.place == (2.5, 0.0, 0.0)
    ear.move((205.0, 0.0, 0.0), 50.0)
    assert ear.place == (205.0, 0.0, 0.0)
