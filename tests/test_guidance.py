"""Guidance: waypoints in order, by the tangent from the turning circle."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fleet.model.flight import Command, State, fly
from fleet.model.guidance import (
    GuidanceSettings,
    Plan,
    Waypoint,
    advance,
    climb_to,
    guide,
    tangent_heading,
)
from fleet.model.scenario import Scenario
from fleet.model.units import wrap_angle

LIMITS = Scenario("guidance", 100.0).limits()
TICK_S = 0.1
SPEED_MPS = 25.0
RADIUS_M = LIMITS.turn_radius_m(SPEED_MPS)
"""110.4 m."""
CRUISE = GuidanceSettings(SPEED_MPS, climb_mps=3.0, level_off_s=3.0, arrival_radius_m=100.0)
PRECISE = GuidanceSettings(SPEED_MPS, climb_mps=3.0, level_off_s=3.0, arrival_radius_m=20.0)

TURNING_DRIFT_RAD = 0.003
"""Measured 0.0021 at a tick of 0.1 s."""

SETTINGS = settings(deadline=None, derandomize=True, max_examples=60)
headings = st.floats(-math.pi, math.pi)
places = st.tuples(st.floats(-1500.0, 1500.0), st.floats(-1500.0, 1500.0))


def at(heading_rad: float, down_m: float = -300.0, path_rad: float = 0.0) -> State:
    return State(0.0, 0.0, down_m, SPEED_MPS, heading_rad, path_rad)


def flight(
    plan: Plan, state: State, rules: GuidanceSettings, ticks: int
) -> list[tuple[Plan, State, Command]]:
    """Plan, state and command at each tick until arrival, or so many ticks."""
    plan = advance(plan, state, rules)
    out = [(plan, state, guide(plan, state, rules, LIMITS))]
    while not plan.arrived and len(out) <= ticks:
        state = fly(state, out[-1][2], LIMITS, TICK_S)
        plan = advance(plan, state, rules)
        out.append((plan, state, guide(plan, state, rules, LIMITS)))
    return out


def arrives(waypoint: Waypoint, state: State, ticks: int) -> bool:
    return flight(Plan((waypoint,)), state, PRECISE, ticks)[-1][0].arrived


def test_waypoints_are_ticked_off_one_by_one_in_order() -> None:
    waypoints = ((1000.0, 0.0, -300.0), (1000.0, 1500.0, -300.0), (0.0, 1500.0, -300.0))
    track = flight(Plan(waypoints), at(0.0), CRUISE, 3000)
    actives = [plan.active for plan, _, _ in track]
    assert actives == sorted(actives)
    assert sorted(set(actives)) == [0, 1, 2, 3]
    for number, waypoint in enumerate(waypoints):
        _, state, _ = track[actives.index(number + 1)]
        assert math.dist(state.position_ned_m[:2], waypoint[:2]) <= CRUISE.arrival_radius_m


def test_a_later_waypoint_is_not_ticked_off_before_its_turn() -> None:
    plan = Plan(((5000.0, 0.0, -300.0), (0.0, 0.0, -300.0)))
    assert advance(plan, at(0.0), CRUISE) == plan


def test_waypoints_reached_together_are_ticked_off_together() -> None:
    plan = Plan(((10.0, 0.0, -300.0), (50.0, 0.0, -300.0), (900.0, 0.0, -300.0)))
    assert advance(plan, at(0.5), CRUISE).active == 2


@pytest.mark.parametrize(("distance", "active"), [(100.0, 1), (100.001, 0)])
def test_a_waypoint_is_reached_within_the_arrival_radius_at_any_height(
    distance: float, active: int
) -> None:
    plan = Plan(((distance, 0.0, -900.0), (9000.0, 0.0, -300.0)))
    assert advance(plan, at(0.0), CRUISE).active == active


def test_after_the_last_waypoint_the_heading_is_held_and_the_height_regained() -> None:
    arrived = advance(Plan(((10.0, 0.0, -320.0),)), at(0.7), CRUISE)
    assert arrived.arrived
    assert arrived.waypoint == (10.0, 0.0, -320.0)
    assert guide(arrived, at(2.0), CRUISE, LIMITS) == Command(0.7, 3.0, SPEED_MPS)


@SETTINGS
@given(headings, places)
def test_after_the_arc_to_the_tangent_heading_the_waypoint_is_dead_ahead(
    heading: float, place: tuple[float, float]
) -> None:
    state = at(heading)
    off_nose = wrap_angle(math.atan2(place[1], place[0]) - heading)
    side = 1.0 if off_nose >= 0.0 else -1.0
    centre = (-side * RADIUS_M * math.sin(heading), side * RADIUS_M * math.cos(heading))
    assume(math.dist(centre, place) > RADIUS_M + 1.0)
    aim = tangent_heading(state, (*place, -300.0), RADIUS_M)
    assume(abs(abs(wrap_angle(aim - heading)) - 0.9 * math.pi) > 1e-6)
    leaving = (
        centre[0] + side * RADIUS_M * math.sin(aim),
        centre[1] - side * RADIUS_M * math.cos(aim),
    )
    bearing = math.atan2(place[1] - leaving[1], place[0] - leaving[0])
    assert wrap_angle(bearing - aim) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("heading_deg", [-150.0, -90.0, -20.0, 45.0, 120.0, 150.0])
def test_the_commanded_heading_stays_put_while_the_turn_lasts(heading_deg: float) -> None:
    start = at(math.radians(heading_deg))
    track = flight(Plan(((2000.0, 0.0, -300.0),)), start, CRUISE, 300)
    first = track[0][2].heading_rad
    turning = [
        command.heading_rad
        for _, state, command in track
        if abs(wrap_angle(first - state.heading_rad)) > 0.01
    ]
    assert len(turning) > 10
    assert max(abs(wrap_angle(h - first)) for h in turning) < TURNING_DRIFT_RAD


@pytest.mark.parametrize("heading_deg", [-179.0, -170.0, 175.0, 180.0])
def test_a_turn_of_more_than_half_a_circle_keeps_its_sense(heading_deg: float) -> None:
    track = flight(Plan(((1000.0, 0.0, -300.0),)), at(math.radians(heading_deg)), CRUISE, 2000)
    turned = [
        wrap_angle(after.heading_rad - before.heading_rad)
        for (_, before, _), (_, after, _) in pairwise(track)
    ]
    large = [x for x in turned if abs(x) > 0.01]
    assert len({x > 0.0 for x in large}) == 1
    assert abs(sum(large)) > math.radians(175.0)
    assert track[-1][0].arrived


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_inside_the_turning_circle_the_present_heading_is_held(side: float) -> None:
    state = at(0.4)
    beside = state.heading_rad + side * math.pi / 2
    waypoint = (RADIUS_M * math.cos(beside), RADIUS_M * math.sin(beside), -300.0)
    assert tangent_heading(state, waypoint, RADIUS_M) == state.heading_rad


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("abeam_m", [40.0, 110.0, 200.0])
def test_a_waypoint_inside_the_turning_circle_is_still_reached(side: float, abeam_m: float) -> None:
    assert arrives((0.0, side * abeam_m, -300.0), at(0.0), ticks=700)


@SETTINGS
@given(headings, places)
def test_any_waypoint_is_reached_from_any_heading_in_bounded_time(
    heading: float, place: tuple[float, float]
) -> None:
    """Straight there, one full circle and a detour of two diameters at most."""
    path_m = math.hypot(*place) + (math.tau + 4.0) * RADIUS_M
    assert arrives((*place, -300.0), at(heading), math.ceil(path_m / SPEED_MPS / TICK_S))


@SETTINGS
@given(st.floats(-80.0, 80.0), st.floats(-0.2, 0.2))
def test_the_altitude_is_regained_and_then_held(error_m: float, path_rad: float) -> None:
    plan = Plan(((9000.0, 0.0, -300.0),))
    track = flight(plan, at(0.0, -300.0 + error_m, path_rad), CRUISE, 600)
    settled = [abs(state.down_m + 300.0) for _, state, _ in track[500:]]
    assert max(settled) < 0.1


@pytest.mark.parametrize("error_m", [-60.0, -5.0, 5.0, 60.0])
def test_the_altitude_is_not_passed_from_level_flight(error_m: float) -> None:
    plan = Plan(((9000.0, 0.0, -300.0),))
    track = flight(plan, at(0.0, -300.0 + error_m), CRUISE, 600)
    left = [(state.down_m + 300.0) * math.copysign(1.0, error_m) for _, state, _ in track]
    assert min(left) > -0.05


@pytest.mark.parametrize(
    ("down_m", "climb_mps"), [(-300.0, 0.0), (-297.0, 1.0), (-303.0, -1.0), (0.0, 3.0), (-900, -3)]
)
def test_the_commanded_climb_closes_the_error_within_its_bounds(
    down_m: float, climb_mps: float
) -> None:
    assert climb_to(-300.0, down_m, CRUISE) == pytest.approx(climb_mps)
