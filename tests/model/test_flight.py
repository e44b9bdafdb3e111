"""The point mass of eq. 1 to 3, its integrator and the flight controller."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import astuple
from numpy.typing import NDArray

from fleet.model.units import GRAVITY_MPS2, wrap_angle
from fleet.model.vehicle import flight
from fleet.model.vehicle.flight import (
    BankLimits,
    Force,
    Rates,
    Setpoint,
    State,
    Vector,
    derivative,
    fly,
    rk4,
    specific_force,
    velocity_from_local,
)

TICK_S = 0.1
LIMITS = BankLimits(
    acceleration_mps2=2.0,
    bank_rad=math.radians(30.0),
    flight_path_rad=math.radians(15.0),
    flight_path_rate_radps=math.radians(6.0),
)
ROUNDING = 1e-9

headings = st.floats(-math.pi, math.pi)
steep_paths = st.floats(-1.4, 1.4)
paths = st.floats(-LIMITS.flight_path_rad, LIMITS.flight_path_rad)
speeds = st.floats(10.0, 80.0)
forces = st.tuples(*[st.floats(-30.0, 30.0)] * 3)
steps = st.floats(0.001, 1.0)
commands = st.builds(
    Setpoint,
    heading_rad=st.floats(-10.0, 10.0),
    climb_mps=st.floats(-100.0, 100.0),
    speed_mps=st.floats(5.0, 100.0),
)
states = st.builds(
    State,
    north_m=st.just(0.0),
    east_m=st.just(0.0),
    down_m=st.just(-300.0),
    speed_mps=speeds,
    heading_rad=headings,
    flight_path_rad=paths,
)

SETTINGS = settings(deadline=None, derandomize=True, max_examples=150)


def level(speed_mps: float = 25.0, heading_rad: float = 0.0) -> State:
    return State(0.0, 0.0, -300.0, speed_mps, heading_rad)


def flown(state: State, setpoint: Setpoint, ticks: int) -> list[State]:
    out = [state]
    for _ in range(ticks):
        out.append(fly(out[-1], setpoint, LIMITS, TICK_S))
    return out


@SETTINGS
@given(headings, steep_paths)
def test_the_matrix_of_eq_3_is_a_rotation(heading: float, path: float) -> None:
    matrix = velocity_from_local(heading, path)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@SETTINGS
@given(speeds, headings, steep_paths)
def test_the_matrix_of_eq_3_turns_the_ned_velocity_into_the_speed_along_x(
    speed: float, heading: float, path: float
) -> None:
    state = State(0.0, 0.0, 0.0, speed, heading, path)
    in_v = velocity_from_local(heading, path) @ np.array(state.velocity_ned_mps)
    assert in_v == pytest.approx(np.array([speed, 0.0, 0.0]), abs=ROUNDING)
    assert state.climb_mps == pytest.approx(-state.velocity_ned_mps[2])


@SETTINGS
@given(speeds, headings, steep_paths, forces)
def test_the_rates_satisfy_eq_1_in_matrix_form(
    speed: float, heading: float, path: float, force: Force
) -> None:
    rate = derivative((0.0, 0.0, 0.0, speed, heading, path), force)
    left = [rate[3], rate[4] * speed * math.cos(path), -speed * rate[5]]
    gravity = velocity_from_local(heading, path) @ np.array([0.0, 0.0, GRAVITY_MPS2])
    assert np.array(left) == pytest.approx(np.array(force) + gravity, abs=ROUNDING)


@SETTINGS
@given(speeds, headings, steep_paths, forces)
def test_the_ned_velocity_accelerates_by_the_force_and_gravity(
    speed: float, heading: float, path: float, force: Force
) -> None:
    """Newton's law in L, which eq. 1 must amount to: no frame's rotation left over."""
    rate = derivative((0.0, 0.0, 0.0, speed, heading, path), force)
    step = 1e-5

    def velocity(dt_s: float) -> NDArray[np.float64]:
        moved = (speed + rate[3] * dt_s, heading + rate[4] * dt_s, path + rate[5] * dt_s)
        return np.array(State(0.0, 0.0, 0.0, *moved).velocity_ned_mps)

    gravity = np.array([0.0, 0.0, GRAVITY_MPS2])
    expected = velocity_from_local(heading, path).T @ np.array(force) + gravity
    assert (velocity(step) - velocity(-step)) / (2.0 * step) == pytest.approx(expected, abs=1e-4)
    assert rate[:3] == pytest.approx(tuple(velocity(0.0)))


@SETTINGS
@given(speeds, headings, steep_paths, st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_the_specific_force_gives_the_rates_it_was_asked_for(
    speed: float, heading: float, path: float, wanted: tuple[float, float, float]
) -> None:
    y = (0.0, 0.0, 0.0, speed, heading, path)
    assert derivative(y, specific_force(y, Rates(*wanted)))[3:] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("speed", [15.0, 25.0, 60.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_turn_at_the_bank_limit_is_a_circle_of_the_coordinated_radius(
    speed: float, side: float
) -> None:
    radius = speed**2 / (GRAVITY_MPS2 * math.tan(LIMITS.bank_rad))
    ticks = 500
    tick_s = math.tau * radius / speed / ticks
    state = level(speed)
    for _ in range(ticks):
        ahead = Setpoint(state.heading_rad + side * 2.0, 0.0, speed)
        state = fly(state, ahead, LIMITS, tick_s)
        from_centre = math.hypot(state.north_m, state.east_m - side * radius)
        assert from_centre == pytest.approx(radius, rel=1e-7)
        assert state.down_m == pytest.approx(-300.0, abs=1e-6)
    assert (state.north_m, state.east_m) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert LIMITS.turn_radius_m(speed) == pytest.approx(radius)


def test_a_turn_at_the_bank_limit_needs_the_force_of_that_bank() -> None:
    y = (0.0, 0.0, 0.0, 25.0, 0.3, 0.0)
    _, right, down = specific_force(y, Rates(0.0, LIMITS.turn_rate_radps(25.0), 0.0))
    assert math.atan2(right, -down) == pytest.approx(LIMITS.bank_rad)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, -2.0])
def test_straight_flight_covers_speed_times_time(heading: float) -> None:
    end = flown(level(25.0, heading), Setpoint(heading, 0.0, 25.0), 100)[-1]
    expected = (250.0 * math.cos(heading), 250.0 * math.sin(heading), -300.0)
    assert end.position_ned_m == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("climb", [-4.0, 3.0])
def test_a_steady_climb_is_a_straight_ramp(climb: float) -> None:
    path = math.asin(climb / 25.0)
    start = State(0.0, 0.0, -300.0, 25.0, 0.0, path)
    end = flown(start, Setpoint(0.0, climb, 25.0), 100)[-1]
    expected = (250.0 * math.cos(path), 0.0, -300.0 - 10.0 * climb)
    assert end.position_ned_m == pytest.approx(expected, abs=1e-6)


def test_a_climb_is_entered_at_the_path_rate_limit_and_then_held() -> None:
    climb = 5.0
    track = flown(level(), Setpoint(0.0, climb, 25.0), 50)
    wanted = math.asin(climb / 25.0)
    for tick, state in enumerate(track):
        ramp = min(LIMITS.flight_path_rate_radps * TICK_S * tick, wanted)
        assert state.flight_path_rad == pytest.approx(ramp, abs=ROUNDING)


def test_an_acceleration_is_flown_at_its_limit_until_the_speed_is_reached() -> None:
    track = flown(level(20.0), Setpoint(0.0, 0.0, 25.0), 40)
    for tick, state in enumerate(track):
        expected = min(20.0 + LIMITS.acceleration_mps2 * TICK_S * tick, 25.0)
        assert state.speed_mps == pytest.approx(expected)


def test_the_integrator_is_of_fourth_order() -> None:
    """A held force lets path angle and speed swing (a phugoid) while the heading drifts."""

    def end(step_s: float) -> Vector:
        y: Vector = (0.0, 0.0, -300.0, 25.0, 0.2, 0.1)
        for _ in range(round(20.0 / step_s)):
            y = rk4(y, lambda _: (0.0, 2.0, -9.0), step_s)
        return y

    exact = end(1.0 / 64.0)
    errors = [math.dist(end(step)[:3], exact[:3]) for step in (1.0, 0.5, 0.25)]
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(16.0, rel=0.2)


@SETTINGS
@given(states, commands, steps)
def test_no_command_makes_the_uav_leave_its_limits(
    state: State, setpoint: Setpoint, step: float
) -> None:
    after = fly(state, setpoint, LIMITS, step)
    turned = abs(wrap_angle(after.heading_rad - state.heading_rad))
    tilted = abs(after.flight_path_rad - state.flight_path_rad)
    coordinated = GRAVITY_MPS2 * math.tan(LIMITS.bank_rad) / state.speed_mps
    assert turned <= coordinated * step + ROUNDING
    assert tilted <= LIMITS.flight_path_rate_radps * step + ROUNDING
    assert abs(after.flight_path_rad) <= LIMITS.flight_path_rad + ROUNDING
    assert abs(after.speed_mps - state.speed_mps) <= LIMITS.acceleration_mps2 * step + ROUNDING


@pytest.mark.parametrize("climb", [-100.0, -10.0, 10.0, 100.0])
def test_the_path_angle_stops_at_its_limit_under_a_lasting_command(climb: float) -> None:
    paths_flown = [s.flight_path_rad for s in flown(level(), Setpoint(0.0, climb, 25.0), 60)]
    assert max(map(abs, paths_flown)) == pytest.approx(LIMITS.flight_path_rad)
    assert paths_flown[-1] == pytest.approx(math.copysign(LIMITS.flight_path_rad, climb))


@SETTINGS
@given(states, commands, steps)
def test_the_controller_never_passes_what_it_is_told_to_fly(
    state: State, setpoint: Setpoint, step: float
) -> None:
    after = fly(state, setpoint, LIMITS, step)
    before_error = wrap_angle(setpoint.heading_rad - state.heading_rad)
    after_error = wrap_angle(setpoint.heading_rad - after.heading_rad)
    assert abs(after_error) <= abs(before_error) + ROUNDING
    assert after_error * before_error >= -ROUNDING
    low, high = sorted((state.speed_mps, setpoint.speed_mps))
    assert low - ROUNDING <= after.speed_mps <= high + ROUNDING


@SETTINGS
@given(states, st.floats(-0.02, 0.02))
def test_a_heading_within_reach_of_one_tick_is_reached_in_it(state: State, change: float) -> None:
    heading = wrap_angle(state.heading_rad + change * 10.0 / state.speed_mps)
    after = fly(state, Setpoint(heading, state.climb_mps, state.speed_mps), LIMITS, TICK_S)
    assert wrap_angle(after.heading_rad - heading) == pytest.approx(0.0, abs=ROUNDING)


zeros = st.sampled_from([0.0, -0.0])


@SETTINGS
@given(st.one_of(headings, zeros), speeds, st.tuples(*[st.floats(-1e5, 1e5)] * 3), zeros, zeros)
def test_flying_on_as_before_gives_the_bits_of_the_general_flight(
    heading: float, speed: float, place: tuple[float, float, float], path: float, climb: float
) -> None:
    state, told = State(*place, speed, heading, path), Setpoint(heading, climb, speed)
    flown = fly(state, told, LIMITS, TICK_S)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flight, "_steady", lambda *_: False)
        general = fly(state, told, LIMITS, TICK_S)
    assert [v.hex() for v in astuple(flown)] == [v.hex() for v in astuple(general)]
