"""Overlap of protected cylinders along sampled trajectories (eq. 4, 8, 9)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.scenario import Scenario
from fleet.model.conflict.risk import (
    Growth,
    Required,
    first_overlap_s,
    normalised_separation,
    sample_times,
)
from fleet.model.types import Array
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.intent import Intent

SCENARIO = Scenario("risk", 100.0)
MODEL = SCENARIO.model(1)
LIMITS = MODEL.limits
REQUIRED = Required(400.0, 50.0)
HORIZON_S = 40.0
STEP_S = 1.0
TIMES_S = sample_times(HORIZON_S, STEP_S)
DENSE_S = sample_times(HORIZON_S, 0.02)
TOP_SPEED_MPS = 40.0
WIDENED = REQUIRED.widened(LIMITS, TOP_SPEED_MPS, STEP_S)
SETTINGS = settings(deadline=None, derandomize=True, max_examples=150)

Movement = tuple[State, Intent]


def movement(heading: float, speed: float, turn: float, climb: float) -> Movement:
    state = State(0.0, 0.0, -300.0, speed, heading)
    return state, Intent(heading + turn, climb)


def movements(curved: bool) -> st.SearchStrategy[Movement]:
    turns = st.floats(-3.0, 3.0) if curved else st.just(0.0)
    climbs = st.floats(-5.0, 5.0) if curved else st.just(0.0)
    return st.builds(
        movement, st.floats(-math.pi, math.pi), st.floats(15.0, TOP_SPEED_MPS), turns, climbs
    )


offsets = st.tuples(st.floats(-600.0, 600.0), st.floats(-600.0, 600.0), st.floats(-80.0, 80.0))
meeting_times = st.floats(0.0, HORIZON_S)


def relative(pair: tuple[Movement, Movement], times_s: Array) -> Array:
    positions = MODEL.positions(courses(pair), times_s)
    out: Array = positions[0] - positions[1]
    return out


class LoggedAdvisory:
    """Two UAVs placed so that at some time one is at a given offset from the other."""

    def __init__(
        self, one: Movement, two: Movement, offset: tuple[float, float, float], time_s: float
    ) -> None:
        self._pair = (one, two)
        self._shift = np.array(offset) - relative(self._pair, np.array([time_s]))[0]

    def __repr__(self) -> str:
        """Shown by Hypothesis."""
        return f"{self._pair} shifted by {self._shift}"

    def relative(self, times_s: Array) -> Array:
        """Relative positions, shape (n, 3)."""
        out: Array = relative(self._pair, times_s) + self._shift
        return out


curved_encounters = st.builds(
    LoggedAdvisory, movements(curved=True), movements(curved=True), offsets, meeting_times
)
straight_encounters = st.builds(
    LoggedAdvisory, movements(curved=False), movements(curved=False), offsets, meeting_times
)


def first_s(relative_m: Array, required: Required = REQUIRED) -> float:
    return float(first_overlap_s(relative_m, TIMES_S, required))


def straight(start: tuple[float, float, float], velocity: tuple[float, float, float]) -> Array:
    out: Array = np.array(start) + TIMES_S[:, None] * np.array(velocity)
    return out


@SETTINGS
@given(curved_encounters)
def test_no_violation_slips_between_the_samples(encounter: LoggedAdvisory) -> None:
    lost = np.flatnonzero(normalised_separation(encounter.relative(DENSE_S), REQUIRED) < 1.0)
    found = first_s(encounter.relative(TIMES_S), WIDENED)
    if len(lost):
        assert found <= DENSE_S[lost[0]] + 1e-9


def test_two_opposite_turns_that_graze_between_samples_are_seen_by_the_whole_widening() -> None:
    """Side by side, each turning away: nearest at half a sample, and apart at both its ends."""
    half_s = 0.5 * LIMITS.turn_rate_radps(25.0)
    pair = (movement(-half_s, 25.0, 1.0, 0.0), movement(half_s, 25.0, -1.0, 0.0))
    nearest = relative(pair, np.array([0.5]))[0]
    shift = np.array([0.0, REQUIRED.horizontal_m - 0.1, 0.0]) - nearest
    path = relative(pair, TIMES_S) + shift
    assert (normalised_separation(path, REQUIRED) > 1.0).all()
    assert first_s(path) == math.inf
    assert first_s(path, WIDENED) < 0.5


def test_two_opposite_pulls_that_graze_between_samples_are_seen_by_the_whole_widening() -> None:
    half_s = 0.5 * LIMITS.pitch_rate_radps(TOP_SPEED_MPS)
    pair = (
        (State(0.0, 0.0, -300.0, TOP_SPEED_MPS, 0.0, -half_s), Intent(0.0, 8.0)),
        (State(0.0, 0.0, -300.0, TOP_SPEED_MPS, 0.0, half_s), Intent(0.0, -8.0)),
    )
    nearest = relative(pair, np.array([0.5]))[0]
    path = relative(pair, TIMES_S) - nearest - np.array([0.0, 0.0, REQUIRED.vertical_m - 0.1])
    assert (normalised_separation(path, REQUIRED) > 1.0).all()
    assert first_s(path) == math.inf
    assert first_s(path, WIDENED) < 0.5


@SETTINGS
@given(curved_encounters)
def test_an_overlap_found_is_real_but_for_the_widening(encounter: LoggedAdvisory) -> None:
    found = first_s(encounter.relative(TIMES_S), WIDENED)
    if math.isfinite(found):
        twice = WIDENED.widened(LIMITS, TOP_SPEED_MPS, STEP_S)
        then = encounter.relative(np.array([found]))
        assert normalised_separation(then, twice)[0] <= 1.0 + 1e-9


@SETTINGS
@given(straight_encounters)
def test_straight_pairs_are_solved_exactly(encounter: LoggedAdvisory) -> None:
    lost = np.flatnonzero(normalised_separation(encounter.relative(DENSE_S), REQUIRED) < 1.0)
    found = first_s(encounter.relative(TIMES_S))
    if len(lost):
        assert DENSE_S[lost[0]] - 0.02 - 1e-6 <= found <= DENSE_S[lost[0]] + 1e-6
    elif math.isfinite(found):
        then = encounter.relative(np.array([found]))
        assert normalised_separation(then, REQUIRED)[0] == pytest.approx(1.0, abs=1e-6)


@SETTINGS
@given(curved_encounters)
def test_swapping_the_pair_changes_nothing(encounter: LoggedAdvisory) -> None:
    path = encounter.relative(TIMES_S)
    assert first_s(path) == first_s(-path)


@SETTINGS
@given(curved_encounters, st.floats(1.0, 3.0), st.floats(1.0, 3.0))
def test_a_larger_zone_is_entered_no_later(
    encounter: LoggedAdvisory, wide: float, high: float
) -> None:
    path = encounter.relative(TIMES_S)
    larger = Required(REQUIRED.horizontal_m * wide, REQUIRED.vertical_m * high)
    assert first_s(path, larger) <= first_s(path) + 1e-9


@pytest.mark.parametrize("distance", [500.0, 1234.5, 2000.0])
@pytest.mark.parametrize("miss", [0.0, 100.0, -399.0])
def test_a_head_on_pair_overlaps_when_the_closing_speed_says(distance: float, miss: float) -> None:
    found = first_s(straight((distance, miss, 20.0), (-50.0, 0.0, 0.0)))
    assert found == pytest.approx((distance - math.sqrt(400.0**2 - miss**2)) / 50.0)


def test_a_climb_through_another_overlaps_when_the_heights_meet() -> None:
    found = first_s(straight((100.0, 100.0, 120.0), (0.0, 0.0, -3.0)))
    assert found == pytest.approx((120.0 - 50.0) / 3.0)


def test_zones_that_meet_level_only_after_passing_each_other_never_overlap() -> None:
    """Horizontally near from 12 s to 28 s, vertically only from 30 s."""
    path = straight((1000.0, 0.0, 140.0), (-50.0, 0.0, -3.0))
    assert first_s(path) == math.inf


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (300.0, -200.0, 49.0), (399.0, 0.0, -49.0)])
def test_a_pair_that_stays_within_both_distances_overlaps_at_once(
    offset: tuple[float, float, float],
) -> None:
    assert first_s(straight(offset, (0.0, 0.0, 0.0))) == 0.0


@pytest.mark.parametrize(
    "offset", [(0.0, 0.0, 50.0), (0.0, 0.0, -60.0), (400.0, 0.0, 0.0), (300.0, 300.0, 10.0)]
)
def test_one_distance_alone_keeps_a_pair_apart(offset: tuple[float, float, float]) -> None:
    assert first_s(straight(offset, (0.0, 0.0, 0.0))) == math.inf


@pytest.mark.parametrize(
    ("start", "velocity"),
    [
        ((1000.0, 400.0, 0.0), (-50.0, 0.0, 0.0)),
        ((-300.0, -400.0, 10.0), (0.0, 0.0, 1.0)),
        ((1000.0, 0.0, 50.0), (-50.0, 0.0, 0.0)),
        ((2400.0, 0.0, 0.0), (-50.0, 0.0, 0.0)),
        ((0.0, 0.0, 130.0), (0.0, 0.0, -2.0)),
        ((700.0, 0.0, 38.0), (-50.0, 0.0, 2.0)),
    ],
)
def test_zones_that_only_touch_do_not_overlap(
    start: tuple[float, float, float], velocity: tuple[float, float, float]
) -> None:
    assert first_s(straight(start, velocity)) == math.inf


@pytest.mark.parametrize("speed", [400.0, 2000.0])
def test_a_pass_shorter_than_a_sample_is_seen(speed: float) -> None:
    path = straight((speed * 10.5, 399.0, 0.0), (-speed, 0.0, 0.0))
    assert first_s(path) == pytest.approx(10.5, abs=0.1)


@SETTINGS
@given(st.floats(-800.0, 800.0), st.floats(-800.0, 800.0), st.floats(-100.0, 100.0))
def test_normalised_separation_is_below_one_exactly_when_the_zones_overlap(
    north: float, east: float, down: float
) -> None:
    place = np.array([north, east, down])
    overlap = math.hypot(north, east) < 400.0 and abs(down) < 50.0
    assert bool(normalised_separation(place, REQUIRED) < 1.0) == overlap


def test_normalised_separation_is_the_larger_ratio() -> None:
    places = np.array([[300.0, 400.0, 0.0], [0.0, 200.0, -75.0], [400.0, 0.0, 50.0]])
    assert normalised_separation(places, REQUIRED).tolist() == [1.25, 1.5, 1.0]


growths = st.builds(Growth, st.floats(0.0, 100.0), st.floats(0.0, 100.0))


@SETTINGS
@given(curved_encounters, growths, st.floats(0.0, 10.0))
def test_scaled_positions_meet_the_required_zone_as_unscaled_ones_meet_the_grown(
    encounter: LoggedAdvisory, growth: Growth, age_s: float
) -> None:
    grown = Required(
        REQUIRED.horizontal_m + growth.horizontal_mps * age_s,
        REQUIRED.vertical_m + growth.vertical_mps * age_s,
    )
    path = encounter.relative(TIMES_S)
    scaled = path * growth.scale(REQUIRED, np.array([age_s]))
    assert normalised_separation(scaled, REQUIRED) == pytest.approx(
        normalised_separation(path, grown)
    )
    assert first_s(scaled) == pytest.approx(first_s(path, grown), abs=1e-6)


def test_each_pair_has_the_scale_of_its_own_age() -> None:
    scale = Growth(100.0, 25.0).scale(REQUIRED, np.array([[0.0], [4.0]]))
    assert scale.tolist() == [[[1.0, 1.0, 1.0]], [[0.5, 0.5, 1.0 / 3.0]]]


def test_either_growth_alone_is_one() -> None:
    told = [bool(Growth(*rates)) for rates in ((), (0.1,), (0.0, 0.1))]
    assert told == [False, True, True]


def test_a_table_of_trajectories_is_judged_entry_by_entry() -> None:
    near = straight((1000.0, 0.0, 0.0), (-50.0, 0.0, 0.0))
    far = straight((1000.0, 0.0, 60.0), (-50.0, 0.0, 0.0))
    table = np.stack([[near, far, near], [far, far, far]])
    expected = [[12.0, math.inf, 12.0], [math.inf] * 3]
    found = first_overlap_s(table, TIMES_S, REQUIRED)
    assert found.shape == (2, 3)
    assert found.tolist() == [[pytest.approx(x) for x in row] for row in expected]


@pytest.mark.parametrize(("horizon", "step"), [(40.0, 1.0), (10.0, 3.0), (0.5, 2.0)])
def test_samples_span_the_horizon_in_equal_steps_no_longer_than_asked(
    horizon: float, step: float
) -> None:
    times = sample_times(horizon, step)
    assert (times[0], times[-1]) == (0.0, horizon)
    assert np.diff(times) == pytest.approx(np.diff(times)[0])
    assert np.diff(times).max() <= step + 1e-12
