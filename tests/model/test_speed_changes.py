"""Changes of speed are flown as they are predicted, in turns, climbs and through waypoints."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.agents.vehicle import ScheduledManoeuvre, Vehicle
from fleet.config.scenario import Scenario, Uav
from fleet.model.conflict.tracks import ActiveManoeuvre, CommandId, StateReport, ages_s, states_at
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.intent import Intent
from fleet.model.vehicle.speed_changes import flown_m, speed_changes, time_to_fly_s
from fleet.protocol.messages import StateBroadcast
from fleet.protocol.surveillance import broadcast_of, report_of
from tests.support.samples import S

SCENARIO = Scenario("pace", 100.0, uav=(Uav(1, (0.0, 0.0, -300.0), 0.0, ((9e3, 0.0, -300.0),)),))
MODEL = SCENARIO.model(1)
TICK_S, TICKS = SCENARIO.tick_s, 600
TIMES_S: Array = np.linspace(0.0, TICKS * TICK_S, TICKS + 1)
STRAIGHT_M, CLIMBING_M, TURNING_M = 0.005, 0.4, 2.0
"""Greatest error over 60 s of a course that is straight and level, or climbs, or turns."""
BENDING_M = 10.0
"""The same through a waypoint, as of a course at one speed (see test_bends)."""
WIDER_M = 40.0
"""The same at a greater speed than guidance's, by whose turning radius the next leg is told."""
SETTINGS = settings(deadline=None, derandomize=True, max_examples=60)

speeds = st.floats(12.0, 40.0)
shares = st.floats(0.7, 1.4)


def error_m(start: State, intent: Intent) -> tuple[float, State]:
    """Greatest error of the prediction over 60 s, and the state at the end."""
    path = MODEL.positions(courses([(start, intent)]), TIMES_S)[0]
    told, state, worst_m = (
        Setpoint(intent.heading_rad, intent.climb_mps, intent.speed_mps),
        start,
        0.0,
    )
    for tick in range(1, TICKS + 1):
        state = MODEL.step(state, told, TICK_S)
        worst_m = max(worst_m, math.dist(path[tick], state.position_ned_m))
    return worst_m, state


@SETTINGS
@given(speeds, shares, st.floats(-3.1, 3.1), st.floats(-3.0, 3.0), st.booleans(), st.booleans())
def test_a_change_of_speed_is_flown_as_predicted(
    speed: float, share: float, turn: float, climb: float, turns: bool, climbs: bool
) -> None:
    """Straight, climbing, turning or all of it: to the intent's speed, at the limit."""
    start = State(0.0, 0.0, -300.0, speed, 0.3)
    intent = Intent(0.3 + turn * turns, climb * climbs, speed_mps=share * speed)
    worst_m, end = error_m(start, intent)
    assert worst_m < (TURNING_M if turns else CLIMBING_M if climbs else STRAIGHT_M)
    (state,) = MODEL.states(courses([(start, intent)]), np.array([60.0]))
    assert state.speed_mps == pytest.approx(share * speed, abs=1e-9)
    assert math.dist(state.position_ned_m, end.position_ned_m) < TURNING_M
    assert wrap_angle(state.heading_rad - end.heading_rad) == pytest.approx(0.0, abs=1e-3)


@SETTINGS
@given(speeds, shares, st.floats(-3.1, 3.1), st.floats(0.0, 10.0), st.floats(0.0, 40.0))
def test_predicting_on_from_within_a_change_stays_on_the_same_trajectory(
    speed: float, share: float, turn: float, first_s: float, then_s: float
) -> None:
    start, intent = (
        State(0.0, 0.0, -300.0, speed, 0.3),
        Intent(0.3 + turn, 0.0, speed_mps=share * speed),
    )
    course = courses([(start, intent)])
    (between,) = MODEL.states(course, np.array([first_s]))
    resumed = MODEL.positions(courses([(between, intent)]), np.array([then_s]))[0, 0]
    direct = MODEL.positions(course, np.array([first_s + then_s]))[0, 0]
    assert math.dist(direct, resumed) < 1e-6


def test_a_speed_that_is_flown_already_changes_nothing() -> None:
    state = State(0.0, 0.0, -300.0, 25.0, 0.3)
    kept, told = (courses([(state, Intent(1.0, 2.0, speed_mps=v))]) for v in (math.nan, 25.0))
    assert kept.intent_speed_mps is None
    assert told.intent_speed_mps is None
    assert speed_changes(np.array([25.0]), np.array([25.0]), 2.0) is None


def test_those_who_change_their_speed_are_predicted_with_others_as_alone() -> None:
    pairs = [
        (State(0.0, 0.0, -300.0, 25.0, 0.3), Intent(1.0, 2.0, speed_mps=20.0)),
        (State(5.0, 0.0, -300.0, 25.0, 0.3), Intent(0.3, 0.0)),
        (State(9.0, 0.0, -300.0, 30.0, 0.3), Intent(-1.0, 0.0, -320.0, speed_mps=36.0)),
    ]
    together = MODEL.positions(courses(pairs), TIMES_S)
    for row, pair in zip(together, pairs, strict=True):
        assert row == pytest.approx(MODEL.positions(courses([pair]), TIMES_S)[0], abs=1e-9)


@SETTINGS
@given(speeds, shares, st.floats(0.0, 4000.0))
def test_a_way_takes_the_time_in_which_it_is_flown(speed: float, share: float, way: float) -> None:
    at, to, ways = (np.array([x]) for x in (speed, share * speed, way))
    took_s = time_to_fly_s(at, to, 2.0, ways)
    assert flown_m(at, to, 2.0, took_s) == pytest.approx(ways, abs=1e-6)


# The vehicle, and what it says


def told_to_fly(speed_mps: float, *waypoints: tuple[float, float, float]) -> Vehicle:
    """A UAV of 25 m/s that is told another speed from the start, for 40 s."""
    one = Uav(1, (0.0, 0.0, -300.0), 0.0, waypoints or ((9e3, 0.0, -300.0),))
    vehicle = Vehicle(one, SCENARIO)
    told = ActiveManoeuvre("speed", 0.0, 0.0, speed_mps=speed_mps)
    vehicle.obey(ScheduledManoeuvre(CommandId(1, 1, 1), told, 0, 40 * S))
    return vehicle


def heard(vehicle: Vehicle) -> StateReport:
    """What others hear of it."""
    report = vehicle.report(vehicle.state, vehicle.now_ns)
    return report_of(broadcast_of(report, vehicle.now_ns, 0))


@pytest.mark.parametrize("speed_mps", [18.75, 23.0, 31.25])
def test_the_speed_of_a_manoeuvre_is_flown_told_and_ended(speed_mps: float) -> None:
    vehicle = told_to_fly(speed_mps)
    assert vehicle.commanded().speed_mps == speed_mps
    vehicle.fly_to(S)
    gained = math.copysign(2.0, speed_mps - 25.0)  # a second at the limit
    within = min(abs(gained), abs(speed_mps - 25.0))
    assert vehicle.state.speed_mps == pytest.approx(25.0 + math.copysign(within, gained))
    vehicle.fly_to(39 * S)
    assert vehicle.state.speed_mps == pytest.approx(speed_mps)
    report = heard(vehicle)
    assert report.manoeuvre
    assert (report.manoeuvre.manoeuvre, report.manoeuvre.speed_mps) == ("speed", speed_mps)
    assert (report.guidance.speed_mps, report.intent().speed_mps) == (25.0, speed_mps)
    vehicle.fly_to(41 * S)  # it has lapsed, and the speed is being regained
    assert heard(vehicle).manoeuvre is None
    assert heard(vehicle).guidance.speed_mps == pytest.approx(25.0)
    vehicle.fly_to(60 * S)
    assert vehicle.state.speed_mps == pytest.approx(25.0, abs=1e-9)
    message = broadcast_of(vehicle.report(vehicle.state, 60 * S), 60 * S, 0)
    assert (message.guidance_speed_mps, message.commanded_speed_mps) == (None, None)


CORNERS = ((601.0, 0.0, -300.0), (601.0, 900.0, -330.0))


@pytest.mark.parametrize("speed_mps", [18.75, 31.25])
@pytest.mark.parametrize("at_s", [0.0, 3.0, 15.0])
def test_a_manoeuvre_is_predicted_through_the_next_waypoint(speed_mps: float, at_s: float) -> None:
    """Which is reached later or sooner than guidance would be there."""
    vehicle = told_to_fly(speed_mps, *CORNERS)
    vehicle.fly_to(round(at_s * S))
    report, start_ns = heard(vehicle), vehicle.now_ns
    course = courses([(report.state, report.intent())])
    times = np.arange(0.0, 39.0 - at_s, 1.0)
    found, off_m = MODEL.positions(course, times)[0], 0.0
    for time_s, place in zip(times, found, strict=True):
        vehicle.fly_to(start_ns + round(time_s * S))
        off_m = max(off_m, math.dist(place, vehicle.state.position_ned_m))
    assert vehicle.plan.active > 0
    assert off_m < (WIDER_M if speed_mps > 25.0 else BENDING_M)


@pytest.mark.parametrize("speed_mps", [18.75, 31.25])
def test_the_way_back_to_cruise_speed_is_predicted_through_the_next_waypoint(
    speed_mps: float,
) -> None:
    vehicle = told_to_fly(speed_mps, (1100.0, 0.0, -300.0), (1100.0, 900.0, -330.0))
    vehicle.fly_to(30 * S)
    report, start_ns = heard(vehicle), vehicle.now_ns
    vehicle.obey(ScheduledManoeuvre(CommandId(1, 1, 2), None, start_ns, start_ns))
    times = np.arange(0.0, 50.0, 1.0)
    found, off_m = MODEL.positions(courses([(report.state, report.guidance)]), times)[0], 0.0
    for time_s, place in zip(times, found, strict=True):
        vehicle.fly_to(start_ns + round(time_s * S))
        off_m = max(off_m, math.dist(place, vehicle.state.position_ned_m))
    assert vehicle.plan.active > 0
    assert off_m < BENDING_M


def test_dead_reckoning_under_a_manoeuvre_does_not_forget_the_cruise_speed() -> None:
    """What was reported at 25 m/s is flown on at 20, and goes back to 25 when it is released."""
    vehicle = told_to_fly(25.0)
    report = heard(vehicle)
    slowed = replace_manoeuvre(report, ActiveManoeuvre("speed", 0.0, 0.0, speed_mps=20.0))
    (later,) = states_at([slowed], 10 * S, SCENARIO.models())
    assert later.speed_mps == pytest.approx(20.0)
    intent = slowed.guidance.after(float(ages_s([slowed], 10 * S)[0]))
    (free,) = MODEL.states(courses([(later, intent)]), np.array([10.0]))
    assert free.speed_mps == pytest.approx(25.0)


def replace_manoeuvre(report: StateReport, manoeuvre: ActiveManoeuvre) -> StateReport:
    """The report of one that flies another manoeuvre."""
    fields = {name: getattr(report, name) for name in report.__struct_fields__}
    return StateReport(**{**fields, "manoeuvre": manoeuvre})


def test_a_broadcast_of_cruise_flight_has_no_speeds() -> None:
    one = Vehicle(SCENARIO.uav[0], SCENARIO)
    message = broadcast_of(one.report(one.state, 0), 0, 0)
    assert isinstance(message, StateBroadcast)
    assert report_of(message).guidance.speed_mps == message.speed_mps


def test_a_vehicle_that_changes_its_speed_slowly_is_predicted_so() -> None:
    slow = replace(MODEL.limits, acceleration_mps2=0.25)
    start, intent = State(0.0, 0.0, -300.0, 25.0, 0.0), Intent(0.0, 0.0, speed_mps=20.0)
    (state,) = replace(MODEL, limits=slow).states(courses([(start, intent)]), np.array([8.0]))
    assert state.speed_mps == pytest.approx(23.0)
    assert state.north_m == pytest.approx(8.0 * 24.0)
