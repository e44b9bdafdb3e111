"""Guidance: waypoints in order, by the tangent from the turning circle."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fleet.agents.vehicle import Vehicle
from fleet.config.scenario import Guidance, Scenario, Uav
from fleet.model.units import wrap_angle
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.guidance import (
    WITHIN,
    FlightPlan,
    GuidanceSettings,
    Pilot,
    Waypoint,
    climb_to,
    last_course,
)
from fleet.model.vehicle.tangent import tangent_path

MODEL = Scenario("guidance", 100.0).model(1)
LIMITS = MODEL.limits
TICK_S = 0.1
SPEED_MPS = 25.0
RADIUS_M = LIMITS.turn_radius_m(SPEED_MPS)
"""110.4 m."""


def pilot(speed_mps: float = SPEED_MPS, arrival_radius_m: float = 100.0) -> Pilot:
    return Pilot(GuidanceSettings(speed_mps, 3.0, 3.0, arrival_radius_m), MODEL)


CRUISE, PRECISE = pilot(), pilot(arrival_radius_m=20.0)

TURNING_DRIFT_RAD = 0.003
"""Measured 0.0021 at a tick of 0.1 s."""

SETTINGS = settings(deadline=None, derandomize=True, max_examples=60)
FLIGHTS = settings(deadline=None, derandomize=True, max_examples=25)
headings = st.floats(-math.pi, math.pi)
places = st.tuples(st.floats(-1500.0, 1500.0), st.floats(-1500.0, 1500.0))


def at(heading_rad: float, down_m: float = -300.0, path_rad: float = 0.0) -> State:
    return State(0.0, 0.0, down_m, SPEED_MPS, heading_rad, path_rad)


def plan_of(state: State, *waypoints: Waypoint) -> FlightPlan:
    return FlightPlan(waypoints, last_course((state.position_ned_m, *waypoints), state.heading_rad))


def flight(
    plan: FlightPlan, state: State, rules: Pilot, ticks: int
) -> list[tuple[FlightPlan, State, Setpoint]]:
    """Plan, state and command at each tick until arrival, or so many ticks."""
    plan = rules.advance(plan, state, state)
    out = [(plan, state, rules.guide(plan, state))]
    while not plan.arrived and len(out) <= ticks:
        before, state = state, MODEL.step(state, out[-1][2], TICK_S)
        plan = rules.advance(plan, before, state)
        out.append((plan, state, rules.guide(plan, state)))
    return out


def arrives(waypoint: Waypoint, state: State, ticks: int) -> bool:
    return flight(plan_of(state, waypoint), state, PRECISE, ticks)[-1][0].arrived


def beside_m(plan: FlightPlan, state: State) -> float:
    """How far right of the line of the last leg."""
    north, east = state.north_m - plan.waypoint[0], state.east_m - plan.waypoint[1]
    return east * math.cos(plan.course_rad) - north * math.sin(plan.course_rad)


def test_waypoints_are_ticked_off_one_by_one_in_order() -> None:
    waypoints = ((1000.0, 0.0, -300.0), (1000.0, 1500.0, -300.0), (0.0, 1500.0, -300.0))
    track = flight(plan_of(at(0.0), *waypoints), at(0.0), CRUISE, 3000)
    actives = [plan.active for plan, _, _ in track]
    assert actives == sorted(actives)
    assert sorted(set(actives)) == [0, 1, 2, 3]
    for number, waypoint in enumerate(waypoints):
        _, state, _ = track[actives.index(number + 1)]
        assert math.dist(state.position_ned_m[:2], waypoint[:2]) <= 100.0


def test_a_later_waypoint_is_not_ticked_off_before_its_turn() -> None:
    plan = plan_of(at(0.0), (5000.0, 0.0, -300.0), (0.0, 0.0, -300.0))
    assert CRUISE.advance(plan, at(0.0), at(0.0)) == plan


def test_waypoints_reached_together_are_ticked_off_together() -> None:
    plan = plan_of(at(0.0), (10.0, 0.0, -300.0), (50.0, 0.0, -300.0), (900.0, 0.0, -300.0))
    assert CRUISE.advance(plan, at(0.5), at(0.5)).active == 2


@pytest.mark.parametrize(("distance", "active"), [(100.0, 1), (100.001, 0)])
def test_a_waypoint_is_reached_within_the_arrival_radius_at_any_height(
    distance: float, active: int
) -> None:
    plan = plan_of(at(0.0), (distance, 0.0, -900.0), (9000.0, 0.0, -300.0))
    assert CRUISE.advance(plan, at(0.0), at(0.0)).active == active


@pytest.mark.parametrize(
    ("waypoints", "active"),
    [
        (((500.0, 99.0, -300.0),), 1),  # passed beside, at 500 m
        (((500.0, 101.0, -300.0),), 0),
        (((300.0, 0.0, -300.0), (700.0, 0.0, -300.0)), 2),  # one after the other
        (((700.0, 0.0, -300.0), (300.0, 0.0, -300.0)), 1),  # the second lies behind the first
        (((700.0, 0.0, -300.0), (610.0, 0.0, -300.0)), 2),  # not yet left behind
        (((-500.0, 0.0, -300.0),), 0),
        (((1500.0, 0.0, -300.0),), 0),
    ],
)
def test_waypoints_between_two_states_are_reached_in_their_order(
    waypoints: tuple[Waypoint, ...], active: int
) -> None:
    """1 km straight on, at either end of which no waypoint is within the radius of 100 m."""
    before, after = at(0.0), State(1000.0, 0.0, -300.0, SPEED_MPS, 0.0)
    assert CRUISE.advance(plan_of(before, *waypoints), before, after).active == active


@pytest.mark.parametrize(("tick_s", "slack_s"), [(0.1, 0.2), (1.0, 1.2), (5.0, 5.2)])
def test_legs_take_as_long_as_they_are_however_long_a_tick_is(
    tick_s: float, slack_s: float
) -> None:
    """A leg of 3 km at 60 m/s: 50 s; with a radius of 50 m it ends 0.83 s earlier."""
    guidance = Guidance(arrival_radius_m=50.0)
    scenario = Scenario("ticks", 100.0, tick_s=tick_s, guidance=guidance)
    goal = (3000.0, 0.0, -300.0)
    vehicle = Vehicle(Uav(1, (0.0, 0.0, -300.0), 0.0, (goal,), 60.0), scenario)
    while not vehicle.plan.arrived:
        vehicle.fly_to(vehicle.now_ns + scenario.tick_ns)
    assert 2950.0 / 60.0 <= vehicle.now_ns / 1e9 <= 2950.0 / 60.0 + slack_s


def test_a_turn_is_flown_alike_however_long_a_tick_is() -> None:
    """Back over a waypoint abeam: the ends are where steps of 0.1 s take it, to a step's error."""
    ends = []
    for tick_s in (0.1, 5.0):
        scenario = Scenario("ticks", 100.0, tick_s=tick_s)
        uav = Uav(1, (0.0, 0.0, -300.0), 0.0, ((0.0, 900.0, -300.0), (-900.0, 0.0, -300.0)), 60.0)
        vehicle = Vehicle(uav, scenario)
        while vehicle.now_ns < 60_000_000_000:
            vehicle.fly_to(vehicle.now_ns + scenario.tick_ns)
        ends.append(vehicle.state)
    assert math.dist(ends[0].position_ned_m, ends[1].position_ned_m) < 30.0


@pytest.mark.parametrize(
    ("start", "heading_deg", "waypoints", "course_deg"),
    [
        ((0.0, 0.0), 0.0, [(0.0, 200.0)], 90.0),
        ((0.0, 0.0), 0.0, [(-150.0, 100.0)], 146.3),
        ((0.0, -1000.0), 90.0, [(0.0, 0.0), (150.0, 0.0)], 0.0),
        ((0.0, 0.0), 30.0, [(0.0, 0.0)], 30.0),  # no leg: the heading at the start
        ((0.0, 0.0), 0.0, [(600.0, 600.0), (600.0, 600.0)], 45.0),  # the leg before
        ((0.0, 0.0), 0.0, [(2000.0, 0.0), (0.0, 0.0)], 180.0),
    ],
)
def test_after_the_last_waypoint_the_course_of_the_last_leg_is_flown(
    start: tuple[float, float],
    heading_deg: float,
    waypoints: list[tuple[float, float]],
    course_deg: float,
) -> None:
    scenario = Scenario("last_leg", 400.0)
    goals = tuple((north, east, -300.0) for north, east in waypoints)
    vehicle = Vehicle(Uav(1, (*start, -300.0), heading_deg, goals, SPEED_MPS), scenario)
    while vehicle.now_ns < 400_000_000_000:
        vehicle.fly_to(vehicle.now_ns + scenario.tick_ns)
    assert vehicle.plan.arrived
    off_course = wrap_angle(vehicle.state.heading_rad - math.radians(course_deg))
    assert math.degrees(off_course) == pytest.approx(0.0, abs=0.05)
    assert abs(beside_m(vehicle.plan, vehicle.state)) < 0.1


@FLIGHTS
@given(headings, st.floats(-600.0, 600.0), st.floats(-2000.0, 2000.0))
def test_the_line_of_the_last_leg_is_regained_from_anywhere(
    heading: float, beside: float, along: float
) -> None:
    """Within a turning circle and 6 points on the line; none that lies behind is returned to."""
    plan = FlightPlan(((0.0, 0.0, -320.0),), 0.0, 1)
    state = State(along, beside, -300.0, SPEED_MPS, heading)
    bound_s = (math.tau * RADIUS_M + 6.0 * CRUISE.spacing_m) / SPEED_MPS
    _, states = CRUISE.follow(plan, state, round(bound_s * 1e9))
    assert abs(beside_m(plan, states[-1])) < 0.5
    assert states[-1].heading_rad == pytest.approx(0.0, abs=0.01)
    assert states[-1].down_m == pytest.approx(-320.0, abs=0.1)
    assert min(s.north_m for s in states) > along - 3.0 * RADIUS_M


def test_80_m_beside_the_line_of_the_last_leg_are_soon_made_up_for() -> None:
    """So much an approach to a waypoint at the edge of its radius leaves; 25 m are on plan."""
    plan = FlightPlan(((0.0, 0.0, -300.0),), 0.0, 1)
    _, states = CRUISE.follow(plan, State(0.0, 80.0, -300.0, SPEED_MPS, 0.0), 30_000_000_000)
    assert abs(states[-1].east_m) < 25.0


@SETTINGS
@given(headings, places)
def test_after_the_arc_to_the_tangent_heading_the_waypoint_is_dead_ahead(
    heading: float, place: tuple[float, float]
) -> None:
    state = at(heading)
    off_nose = wrap_angle(math.atan2(place[1], place[0]) - heading)
    assume(abs(off_nose) < math.pi - 1e-6)
    side = 1.0 if off_nose >= 0.0 else -1.0
    centre = (-side * RADIUS_M * math.sin(heading), side * RADIUS_M * math.cos(heading))
    assume(math.dist(centre, place) > RADIUS_M + 1.0)
    intent = heading + tangent_path(state, place, RADIUS_M, 0.0).turn_rad
    leaving = (
        centre[0] + side * RADIUS_M * math.sin(intent),
        centre[1] - side * RADIUS_M * math.cos(intent),
    )
    bearing = math.atan2(place[1] - leaving[1], place[0] - leaving[0])
    assert wrap_angle(bearing - intent) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("heading_deg", [-150.0, -90.0, -20.0, 45.0, 120.0, 150.0])
def test_the_commanded_heading_stays_put_while_the_turn_lasts(heading_deg: float) -> None:
    start = at(math.radians(heading_deg))
    track = flight(plan_of(start, (2000.0, 0.0, -300.0)), start, CRUISE, 300)
    first = track[0][2].heading_rad
    turning = [
        command_id.heading_rad
        for _, state, command_id in track
        if abs(wrap_angle(first - state.heading_rad)) > 0.01
    ]
    assert len(turning) > 10
    assert max(abs(wrap_angle(h - first)) for h in turning) < TURNING_DRIFT_RAD


@pytest.mark.parametrize("heading_deg", [-179.0, -170.0, 175.0, 180.0])
def test_a_turn_of_more_than_half_a_circle_keeps_its_sense(heading_deg: float) -> None:
    start = at(math.radians(heading_deg))
    track = flight(plan_of(start, (1000.0, 0.0, -300.0)), start, CRUISE, 2000)
    turned = [
        wrap_angle(after.heading_rad - before.heading_rad)
        for (_, before, _), (_, after, _) in pairwise(track)
    ]
    large = [x for x in turned if abs(x) > 0.01]
    assert len({x > 0.0 for x in large}) == 1
    assert abs(sum(large)) > math.radians(175.0)
    assert track[-1][0].arrived


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_waypoint_inside_the_turning_circle_is_first_turned_away_from(side: float) -> None:
    """At the centre of one circle, until that has moved by its radius: the chord of 2 radii's arc.

    Less 18 m, of the 20 m within which the waypoint counts as reached.
    """
    state = at(0.4)
    beside = state.heading_rad + side * math.pi / 2
    waypoint = (RADIUS_M * math.cos(beside), RADIUS_M * math.sin(beside))
    way = tangent_path(state, waypoint, RADIUS_M, WITHIN * 20.0)
    assert way.away
    assert way.turn_rad == pytest.approx(
        -side * 2.0 * math.asin((RADIUS_M - 18.0) / 4.0 / RADIUS_M)
    )


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_waypoint_just_inside_the_turning_circle_is_passed_within_its_radius(side: float) -> None:
    """10 m inside, abeam: half a turn passes nearest to it, and the radius is 20 m."""
    state = at(0.4)
    beside = state.heading_rad + side * math.pi / 2
    abeam_m = 2.0 * RADIUS_M - 10.0
    waypoint = (abeam_m * math.cos(beside), abeam_m * math.sin(beside))
    turn = tangent_path(state, waypoint, RADIUS_M, WITHIN * 20.0).turn_rad
    assert math.degrees(turn) == pytest.approx(side * 180.0)


@SETTINGS
@given(headings, places, st.floats(0.0, 100.0))
def test_guidance_never_flies_straight_on_past_its_waypoint(
    heading: float, place: tuple[float, float], within_m: float
) -> None:
    """Straight on is asked for only where the waypoint is near enough to dead ahead."""
    if abs(tangent_path(at(heading), place, RADIUS_M, within_m).turn_rad) < 0.01:
        beside = place[1] * math.cos(heading) - place[0] * math.sin(heading)
        assert abs(beside) <= within_m + 0.01 * math.hypot(*place) + 0.1


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("abeam_m", [40.0, 110.0, 200.0])
def test_a_waypoint_inside_the_turning_circle_is_still_reached(side: float, abeam_m: float) -> None:
    assert arrives((0.0, side * abeam_m, -300.0), at(0.0), ticks=700)


@SETTINGS
@given(headings, places)
def test_any_waypoint_is_reached_from_any_heading_in_bounded_time(
    heading: float, place: tuple[float, float]
) -> None:
    """Straight there, and one full circle and its radius at most."""
    path_m = math.hypot(*place) + (math.tau + 1.0) * RADIUS_M
    assert arrives((*place, -300.0), at(heading), math.ceil(path_m / SPEED_MPS / TICK_S))


@FLIGHTS
@given(
    headings,
    st.floats(12.0, 60.0),
    st.lists(st.tuples(st.floats(150.0, 3000.0), headings), min_size=1, max_size=4),
    st.sampled_from([20.0, 100.0]),
)
def test_every_plan_is_flown_to_its_end_in_bounded_time(
    heading: float, speed: float, legs: list[tuple[float, float]], arrival_radius_m: float
) -> None:
    """For each waypoint: the leg, a full circle and its radius, and what its radius left over."""
    radius = LIMITS.turn_radius_m(speed)
    rules = pilot(speed, max(arrival_radius_m, 0.1 * radius))
    points = [(0.0, 0.0, -300.0)]
    for length, course in legs:
        north, east, down = points[-1]
        points.append((north + length * math.cos(course), east + length * math.sin(course), down))
    state = State(*points[0], speed, heading)
    each_m = (math.tau + 1.0) * radius + 2.0 * rules.settings.arrival_radius_m
    bound_m = sum(length for length, _ in legs) + len(legs) * each_m
    plan = rules.advance(plan_of(state, *points[1:]), state, state)
    plan, states = rules.follow(plan, state, round(bound_m / speed * 1e9))
    assert plan.arrived
    span_s = (math.tau * radius + 4.0 * rules.spacing_m) / speed
    _, states = rules.follow(plan, states[-1], round(span_s * 1e9))
    course = math.atan2(points[-1][1] - points[-2][1], points[-1][0] - points[-2][0])
    assert wrap_angle(states[-1].heading_rad - course) == pytest.approx(0.0, abs=0.02)
    assert abs(beside_m(plan, states[-1])) < 25.0


@SETTINGS
@given(st.floats(-80.0, 80.0), st.floats(-0.2, 0.2))
def test_the_altitude_is_regained_and_then_held(error_m: float, path_rad: float) -> None:
    plan = FlightPlan(((9000.0, 0.0, -300.0),), 0.0)
    track = flight(plan, at(0.0, -300.0 + error_m, path_rad), CRUISE, 600)
    settled = [abs(state.down_m + 300.0) for _, state, _ in track[500:]]
    assert max(settled) < 0.1


@pytest.mark.parametrize("error_m", [-60.0, -5.0, 5.0, 60.0])
def test_the_altitude_is_not_passed_from_level_flight(error_m: float) -> None:
    plan = FlightPlan(((9000.0, 0.0, -300.0),), 0.0)
    track = flight(plan, at(0.0, -300.0 + error_m), CRUISE, 600)
    left = [(state.down_m + 300.0) * math.copysign(1.0, error_m) for _, state, _ in track]
    assert min(left) > -0.05


@pytest.mark.parametrize(
    ("down_m", "climb_mps"), [(-300.0, 0.0), (-297.0, 1.0), (-303.0, -1.0), (0.0, 3.0), (-900, -3)]
)
def test_the_commanded_climb_closes_the_error_within_its_bounds(
    down_m: float, climb_mps: float
) -> None:
    assert climb_to(-300.0, down_m, CRUISE.settings) == pytest.approx(climb_mps)
