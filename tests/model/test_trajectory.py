"""Predicted trajectories (eq. 5 to 7), held against what the flight model then flies."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.agents.vehicle import ScheduledManoeuvre, Vehicle
from fleet.config.scenario import Scenario, Uav
from fleet.model.conflict.command_set import climb_commands, command_set, turn_commands
from fleet.model.conflict.risk import sample_times
from fleet.model.conflict.tracks import ActiveManoeuvre, CommandId, StateReport, intent_of
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.intent import Intent

SCENARIO = Scenario("prediction", 100.0)
MODEL = SCENARIO.model(1)
TICK_S = SCENARIO.tick_s
TICKS = 600
TIMES_S = sample_times(TICKS * TICK_S, TICK_S)
"""T_s = 60 s, every tick of it."""

# Greatest distance between the predicted and the flown position over 60 s at a tick of 0.1 s.
PURE_TURN_M = 0.010
"""Measured 0.0071 m: the last tick of a turn is flown at a lower rate."""
PURE_CLIMB_M = 0.008
"""Measured 0.0051 m, at 40 m/s: the same for the ramp."""
COMMANDED_M = 0.45
"""Measured 0.384 m over the default TC x CC at 25 m/s: the climb begins inside the turn."""
TURN_CLIMB_M = 1.6
"""Measured 1.50 m from level flight, for turns of up to 179 degrees and climbs of up to 8 m/s."""
TURN_CLIMB_FROM_CLIMB_M = 2.6
"""Measured 2.44 m from a climb of 12 degrees into a dive of 8 m/s."""
GUIDED_HORIZONTAL_M = 1.5
"""Measured 1.30 m from level flight and 1.41 m from a climb of 10 degrees."""
GUIDED_AHEAD_M = 0.02
"""Measured 0.0107 m horizontally with the waypoint dead ahead: no turn, but the climb's cosine."""
GUIDED_VERTICAL_M = 0.15
"""Measured 0.111 m from level flight: guidance follows its height while the ramp lasts."""
GUIDED_VERTICAL_FROM_CLIMB_M = 2.3
"""Measured 2.07 m from a climb of 10 degrees one metre off the altitude."""

TURNS_RAD = [math.radians(x) for x in (-175.0, -120.0, -45.0, -3.0, 0.0, 3.0, 60.0, 150.0, 175.0)]
CLIMBS_MPS = [-8.0, -5.0, -1.0, 0.0, 2.0, 5.0, 8.0]
SPEEDS_MPS = [15.0, 25.0, 40.0]
SETTINGS = settings(deadline=None, derandomize=True, max_examples=60)


def start_at(speed_mps: float = 25.0, path_deg: float = 0.0) -> State:
    return State(100.0, -50.0, -300.0, speed_mps, 0.3, math.radians(path_deg))


def flown(state: State, intent: Intent, ticks: int = TICKS) -> list[State]:
    setpoint = Setpoint(intent.heading_rad, intent.climb_mps, state.speed_mps)
    out = [state]
    for _ in range(ticks):
        out.append(MODEL.step(out[-1], setpoint, TICK_S))
    return out


def predicted(state: State, intent: Intent, times_s: Array = TIMES_S) -> Array:
    out: Array = MODEL.positions(courses([(state, intent)]), times_s)[0]
    return out


def places(states: list[State]) -> Array:
    return np.array([s.position_ned_m for s in states])


def error_m(state: State, turn_rad: float, climb_mps: float) -> float:
    intent = Intent(state.heading_rad + turn_rad, climb_mps)
    off = predicted(state, intent) - places(flown(state, intent))
    return float(np.linalg.norm(off, axis=1).max())


def guided(uav: Uav, path_deg: float) -> tuple[StateReport, Array]:
    """What a vehicle reports at first, and where guidance then takes it to the first waypoint."""
    vehicle = Vehicle(uav, SCENARIO)
    vehicle.state = msgspec.structs.replace(vehicle.state, flight_path_rad=math.radians(path_deg))
    report = vehicle.report(vehicle.state, vehicle.now_ns)
    track = [vehicle.state]
    while vehicle.plan.active == 0 and len(track) <= TICKS:
        vehicle.fly_to(vehicle.now_ns + SCENARIO.tick_ns)
        track.append(vehicle.state)
    return report, places(track)


def guided_error_m(
    distance_m: float, heading_deg: float, climb_m: float, path_deg: float
) -> tuple[float, float]:
    """Greatest horizontal and vertical error up to the waypoint."""
    goal = (distance_m, 0.0, -300.0 - climb_m)
    beyond = (distance_m + 20_000.0, 0.0, -300.0 - climb_m)
    report, track = guided(Uav(1, (0.0, 0.0, -300.0), heading_deg, (goal, beyond)), path_deg)
    off = predicted(report.state, report.guidance, TIMES_S[: len(track)]) - track
    return float(np.hypot(off[:, 0], off[:, 1]).max()), float(np.abs(off[:, 2]).max())


@given(st.floats(0.01, math.pi), st.integers(1, 50))
@SETTINGS
def test_turn_commands_are_odd_evenly_spaced_and_symmetric(maximum: float, half: int) -> None:
    turns = turn_commands(maximum, 2 * half + 1)
    assert len(turns) == 2 * half + 1
    assert turns == pytest.approx(-turns[::-1], abs=1e-12)
    assert np.diff(turns) == pytest.approx(maximum / half)
    assert (turns[0], turns[-1]) == (-maximum, maximum)
    assert turns[half] == pytest.approx(0.0, abs=1e-12)


def test_flying_straight_is_exactly_one_of_the_turn_commands() -> None:
    """Exactly: zero is told from the others by its value."""
    for maximum_deg in (30.0, 45.0, 75.0, 90.0, 180.0):
        for count in range(3, 102, 2):
            turns = turn_commands(math.radians(maximum_deg), count)
            assert np.flatnonzero(turns == 0.0).tolist() == [count // 2]
            assert turns.tolist() == (-turns[::-1]).tolist()


@given(st.floats(0.1, 20.0), st.integers(1, 50))
@SETTINGS
def test_climb_commands_are_odd_evenly_spaced_and_symmetric(maximum: float, half: int) -> None:
    climbs = climb_commands(maximum, maximum, 2 * half + 1)
    assert len(climbs) == 2 * half + 1
    assert climbs == pytest.approx(-climbs[::-1], abs=1e-9)
    assert np.diff(climbs) == pytest.approx(maximum / half)
    assert np.flatnonzero(climbs == 0.0).tolist() == [half]


def test_climb_commands_with_unlike_bounds_keep_zero_in_the_middle() -> None:
    assert climb_commands(2.0, 6.0, 5).tolist() == [-2.0, -1.0, 0.0, 3.0, 6.0]


@pytest.mark.parametrize(("turn_count", "climb_count"), [(3, 3), (13, 11), (21, 5)])
def test_the_command_set_has_n_t_plus_n_c_minus_one_members(
    turn_count: int, climb_count: int
) -> None:
    turns, climbs = turn_commands(1.5, turn_count), climb_commands(5.0, 5.0, climb_count)
    pairs = command_set(turns, climbs)
    assert len(pairs) == turn_count + climb_count - 1
    assert len(set(pairs)) == len(pairs)
    assert {tc for tc, cc in pairs if cc == 0.0} == set(turns)
    assert {cc for tc, cc in pairs if tc == 0.0} == set(climbs)
    assert all(tc == 0.0 or cc == 0.0 for tc, cc in pairs)


@pytest.mark.parametrize("speed", SPEEDS_MPS)
def test_a_turn_is_flown_where_it_was_predicted(speed: float) -> None:
    assert max(error_m(start_at(speed), turn, 0.0) for turn in TURNS_RAD) < PURE_TURN_M


@pytest.mark.parametrize("speed", SPEEDS_MPS)
def test_a_climb_is_flown_where_it_was_predicted(speed: float) -> None:
    assert max(error_m(start_at(speed), 0.0, climb) for climb in CLIMBS_MPS) < PURE_CLIMB_M


@pytest.mark.parametrize("path_deg", [-12.0, 12.0])
def test_levelling_off_from_a_climb_is_flown_where_it_was_predicted(path_deg: float) -> None:
    errors = [error_m(start_at(25.0, path_deg), 0.0, climb) for climb in CLIMBS_MPS]
    assert max(errors) < PURE_CLIMB_M


@pytest.mark.parametrize(
    ("speed", "path_deg", "bound_m"),
    [
        (15.0, 0.0, TURN_CLIMB_M),
        (25.0, 0.0, TURN_CLIMB_M),
        (40.0, 0.0, TURN_CLIMB_M),
        (25.0, 12.0, TURN_CLIMB_FROM_CLIMB_M),
        (25.0, -12.0, TURN_CLIMB_FROM_CLIMB_M),
    ],
)
def test_a_climbing_turn_is_flown_where_it_was_predicted(
    speed: float, path_deg: float, bound_m: float
) -> None:
    start = start_at(speed, path_deg)
    errors = [error_m(start, turn, climb) for turn in TURNS_RAD[::2] for climb in CLIMBS_MPS[::2]]
    assert max(errors) < bound_m


def test_the_default_commands_are_flown_where_they_were_predicted() -> None:
    rules = SCENARIO.resolution
    turns = turn_commands(math.radians(rules.max_turn_deg), rules.turn_candidates)
    climbs = climb_commands(rules.max_dive_mps, rules.max_climb_mps, rules.climb_candidates)
    pairs = [(float(tc), float(cc)) for tc in turns[::3] for cc in climbs[::5]]
    assert max(error_m(start_at(), *pair) for pair in pairs) < COMMANDED_M


@pytest.mark.parametrize("half_turn", [math.pi, -math.pi])
def test_a_half_turn_is_predicted_on_the_side_on_which_it_is_flown(half_turn: float) -> None:
    """Both senses are as short; the controller's choice must be the prediction's."""
    start = State(0.0, 0.0, -300.0, 25.0, 0.0)
    intent = Intent(half_turn, 0.0)
    off = predicted(start, intent) - places(flown(start, intent))
    assert float(np.abs(off).max()) < PURE_TURN_M


@pytest.mark.parametrize("climb_m", [-100.0, -8.0, 0.0, 3.0, 50.0])
@pytest.mark.parametrize(
    ("distance_m", "heading_deg"),
    [(300.0, 60.0), (800.0, -155.0), (800.0, 90.0), (1500.0, 155.0), (3000.0, -30.0)],
)
def test_guidance_flies_to_its_waypoint_where_its_report_predicted(
    distance_m: float, heading_deg: float, climb_m: float
) -> None:
    horizontal, vertical = guided_error_m(distance_m, heading_deg, climb_m, 0.0)
    assert horizontal < GUIDED_HORIZONTAL_M
    assert vertical < GUIDED_VERTICAL_M


@pytest.mark.parametrize("climb_m", [-50.0, -3.0, 0.0, 70.0])
def test_guidance_straight_ahead_arrives_when_its_report_predicted(climb_m: float) -> None:
    horizontal, vertical = guided_error_m(1500.0, 0.0, climb_m, 0.0)
    assert horizontal < GUIDED_AHEAD_M
    assert vertical < GUIDED_VERTICAL_M


@pytest.mark.parametrize("climb_m", [-100.0, -1.0, 0.0, 50.0])
@pytest.mark.parametrize("heading_deg", [-155.0, -10.0, 95.0])
@pytest.mark.parametrize("path_deg", [-10.0, 10.0])
def test_guidance_that_takes_over_in_a_climb_flies_where_its_report_predicted(
    heading_deg: float, climb_m: float, path_deg: float
) -> None:
    horizontal, vertical = guided_error_m(800.0, heading_deg, climb_m, path_deg)
    assert horizontal < GUIDED_HORIZONTAL_M
    assert vertical < GUIDED_VERTICAL_FROM_CLIMB_M


@given(
    st.floats(-3.0, 3.0),
    st.floats(-5.0, 5.0),
    st.one_of(st.just(math.nan), st.floats(-400.0, -200.0)),
    st.floats(0.0, 60.0),
)
@SETTINGS
def test_predicted_states_stand_on_the_predicted_positions(
    turn: float, climb: float, level_down: float, time_s: float
) -> None:
    start = start_at()
    course = courses([(start, Intent(start.heading_rad + turn, climb, level_down))])
    (state,) = MODEL.states(course, np.array([time_s]))
    position = MODEL.positions(course, np.array([time_s]))[0, 0]
    assert state.position_ned_m == pytest.approx(tuple(position), abs=1e-9)
    assert state.speed_mps == start.speed_mps


@pytest.mark.parametrize("climb", [-5.0, 0.0, 2.0])
@pytest.mark.parametrize("turn", [-2.0, 0.0, 3.0])
def test_predicted_states_point_where_the_uav_then_points(turn: float, climb: float) -> None:
    start = start_at()
    intent = Intent(start.heading_rad + turn, climb)
    track = flown(start, intent)
    ticks = list(range(0, TICKS + 1, 7))
    course = courses([(start, intent)] * len(ticks))
    for tick, state in zip(ticks, MODEL.states(course, TIMES_S[ticks]), strict=True):
        true = track[tick]
        assert math.dist(state.position_ned_m, true.position_ned_m) < TURN_CLIMB_M
        assert wrap_angle(state.heading_rad - true.heading_rad) == pytest.approx(0.0, abs=1e-6)
        assert state.flight_path_rad == pytest.approx(true.flight_path_rad, abs=1e-6)


@given(st.floats(-3.0, 3.0), st.floats(-5.0, 5.0), st.floats(0.0, 40.0), st.floats(0.0, 20.0))
@SETTINGS
def test_predicting_on_from_a_predicted_state_stays_near_the_same_trajectory(
    turn: float, climb: float, first_s: float, then_s: float
) -> None:
    """Dead reckoning: a track is flown on from its report, then predicted from there."""
    start = start_at()
    intent = Intent(start.heading_rad + turn, climb)
    (between,) = MODEL.states(courses([(start, intent)]), np.array([first_s]))
    direct = predicted(start, intent, np.array([first_s + then_s]))[0]
    resumed = predicted(between, intent, np.array([then_s]))[0]
    assert math.dist(direct, resumed) < TURN_CLIMB_M


def test_many_courses_are_predicted_as_each_would_be_alone() -> None:
    pairs = [
        (start_at(speed, path), Intent(turn, climb, down))
        for speed, path, turn, climb, down in [
            (15.0, 0.0, 1.0, 0.0, math.nan),
            (25.0, 5.0, -2.0, 3.0, -350.0),
            (40.0, -5.0, 0.3, -3.0, math.nan),
        ]
    ]
    together = MODEL.positions(courses(pairs), TIMES_S)
    for row, (state, intent) in zip(together, pairs, strict=True):
        assert row == pytest.approx(predicted(state, intent), abs=1e-9)


def test_a_turn_takes_its_angle_over_the_turn_rate() -> None:
    course = courses([(start_at(), Intent(0.3 + turn, 0.0)) for turn in (0.0, 1.0, -2.0)])
    expected = np.array([0.0, 1.0, 2.0]) / MODEL.limits.turn_rate_radps(25.0)
    assert MODEL.turn_time_s(course) == pytest.approx(expected)


@pytest.mark.parametrize("climb_mps", [-5.0, -2.0, 3.0, 5.0])
@pytest.mark.parametrize("speed_mps", [10.0, 19.5, 25.0, 40.0])
@pytest.mark.parametrize("height_m", [2.0, 20.0, 60.0])
def test_a_manoeuvre_levels_off_as_predicted(
    climb_mps: float, speed_mps: float, height_m: float
) -> None:
    """And never beyond, also where the pull or the path angle bound it (10 m/s)."""
    level = -300.0 - math.copysign(height_m, climb_mps)
    uav = Uav(1, (0.0, 0.0, -300.0), 0.0, ((9000.0, 0.0, -300.0),), speed_mps)
    vehicle = Vehicle(uav, SCENARIO)
    vehicle.obey(
        ScheduledManoeuvre(
            CommandId(1, 1, 1), ActiveManoeuvre("climb", 0.0, climb_mps, level), 0, 2**62
        )
    )
    told = intent_of(Intent(0.0, 0.0, -300.0), vehicle.manoeuvre)
    path = predicted(vehicle.state, told)
    overshoot_m, off_m = 0.0, 0.0
    for tick in range(1, 601):
        vehicle.fly_to(tick * SCENARIO.tick_ns)
        off_m = max(off_m, float(np.abs(path[tick] - vehicle.state.position_ned_m).max()))
        beyond = (level - vehicle.state.down_m) * math.copysign(1.0, climb_mps)
        overshoot_m = max(overshoot_m, beyond)
        if tick in (50, 150):  # predicted again on the way, from what is reported then
            ahead = predicted(vehicle.state, vehicle.report(vehicle.state, 0).intent())
            path[tick:] = ahead[: len(path) - tick]
    assert off_m < 0.5
    assert overshoot_m < 0.25
    assert vehicle.state.down_m == pytest.approx(level, abs=0.02)
