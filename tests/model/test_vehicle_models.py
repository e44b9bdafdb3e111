"""What holds of every vehicle model, also the next one: of those that are known, each is tried.

FLEET_VEHICLE_MODELS=my_vehicle pytest tests/model/test_vehicle_models.py tries one of your own.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis.planned import planned_flight
from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario, Uav
from fleet.errors import ScenarioError
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.intent import Intent, NextCourse
from fleet.model.vehicle.model import LEAST_AIRSPEED_MPS, Performance, VehicleModel
from fleet.model.vehicle.registry import models, vehicle_model

LEVEL_OFF_S = 3.0
TIMES_S = np.arange(0.0, 41.0)
AGREE_M = 3.0
"""Between truth and prediction over 40 s at 25 m/s: 3 parts in 1000 of the way."""
ROUNDING = 1e-9
each = pytest.mark.parametrize("name", models())
tried = settings(deadline=None, derandomize=True, max_examples=40)

speeds = st.floats(15.0, 40.0)
setpoints = st.builds(Setpoint, st.floats(-math.pi, math.pi), st.floats(-5.0, 5.0), speeds)


def model_of(name: str) -> VehicleModel:
    return models()[name]().model(LEVEL_OFF_S)


def start(speed_mps: float = 25.0, heading_rad: float = 0.3, path_rad: float = 0.0) -> State:
    return State(100.0, -50.0, -300.0, speed_mps, heading_rad, path_rad)


def flown(model: VehicleModel, state: State, intent: Intent, tick_s: float) -> list[State]:
    """The truth, tick by tick, as a vehicle steers it: also to level off."""
    speed = state.speed_mps if math.isnan(intent.speed_mps) else intent.speed_mps
    out = [state]
    for _ in range(round(float(TIMES_S[-1]) / tick_s)):
        told = Setpoint(intent.heading_rad, model.climb_mps(intent, out[-1]), speed)
        out.append(model.step(out[-1], told, tick_s))
    return out


def error_m(model: VehicleModel, state: State, intent: Intent, tick_s: float = 0.1) -> float:
    """How far prediction and truth come apart."""
    truth = [s.position_ned_m for s in flown(model, state, intent, tick_s)[:: round(1.0 / tick_s)]]
    told = model.positions(courses([(state, intent)]), TIMES_S)[0]
    return float(np.linalg.norm(told - np.array(truth), axis=1).max())


@each
@tried
@given(speeds, st.floats(-0.9, 0.9), setpoints, st.floats(0.01, 0.2))
def test_a_step_keeps_the_limits(
    name: str, speed: float, steep: float, setpoint: Setpoint, dt_s: float
) -> None:
    model = model_of(name)
    limits = model.limits
    state = start(speed, path_rad=steep * limits.steepest_rad(speed))
    after = model.step(state, setpoint, dt_s)
    fastest = max(speed, after.speed_mps)
    pull_mps2 = limits.pitch_rate_radps(speed) * fastest + limits.acceleration_mps2
    turned = abs(wrap_angle(after.heading_rad - state.heading_rad))
    assert turned <= limits.turn_rate_radps(speed) * dt_s + ROUNDING
    assert abs(after.speed_mps - speed) <= limits.acceleration_mps2 * dt_s + ROUNDING
    assert abs(after.climb_mps - state.climb_mps) <= pull_mps2 * dt_s + ROUNDING
    assert abs(after.flight_path_rad) <= limits.steepest_rad(after.speed_mps) + ROUNDING
    assert math.dist(after.position_ned_m, state.position_ned_m) <= fastest * dt_s * (1.0 + 1e-6)
    assert limits.turn_radius_m(speed) == pytest.approx(speed / limits.turn_rate_radps(speed))


@each
@tried
@given(speeds, setpoints, st.floats(0.01, 0.2))
def test_a_step_is_a_pure_function_that_never_passes_the_setpoint(
    name: str, speed: float, setpoint: Setpoint, dt_s: float
) -> None:
    model, state = model_of(name), start(speed)
    after = model.step(state, setpoint, dt_s)
    assert after == model_of(name).step(state, setpoint, dt_s)
    assert type(after) is State, "what is not in State nobody else can know"
    assert all(type(getattr(after, field)) is float for field in after.__struct_fields__)
    assert -math.pi <= after.heading_rad <= math.pi
    left, before = (wrap_angle(setpoint.heading_rad - s.heading_rad) for s in (after, state))
    assert abs(left) <= abs(before) + ROUNDING
    apart = setpoint.speed_mps - after.speed_mps
    assert apart * (setpoint.speed_mps - speed) >= -ROUNDING


@each
def test_a_setpoint_that_is_held_is_reached(name: str) -> None:
    model, state = model_of(name), start()
    for _ in range(600):
        state = model.step(state, Setpoint(-2.0, 3.0, 20.0), 0.1)
    assert (state.heading_rad, state.climb_mps, state.speed_mps) == pytest.approx((-2.0, 3.0, 20.0))


@each
@settings(deadline=None, derandomize=True, max_examples=15)
@given(
    st.floats(-3.1, 3.1),
    st.sampled_from([-5.0, -2.0, 0.5, 3.0, 5.0]),
    st.sampled_from([math.nan, -300.0, -340.0, -270.0]),
    st.sampled_from([math.nan, 20.0, 30.0]),
)
def test_truth_agrees_with_its_prediction(
    name: str, turn: float, climb: float, level_down_m: float, speed_mps: float
) -> None:
    intent = Intent(wrap_angle(0.3 + turn), climb, level_down_m, None, speed_mps)
    assert error_m(model_of(name), start(), intent) < AGREE_M


@each
def test_a_prediction_is_what_short_ticks_come_to(name: str) -> None:
    model, intent = model_of(name), Intent(2.0, 0.0)
    errors_m = [error_m(model, start(), intent, tick_s) for tick_s in (0.2, 0.1, 0.05)]
    assert errors_m[2] <= errors_m[0] + 0.02
    assert errors_m[2] < 0.3


@each
def test_many_are_predicted_as_each_alone_is(name: str) -> None:
    model = model_of(name)
    pairs = [
        (start(20.0), Intent(1.0, 0.0)),
        (start(25.0), Intent(0.3, 3.0, -330.0)),
        (start(30.0), Intent(-2.0, 0.0, speed_mps=25.0)),
        (start(), Intent(0.3, 0.0, then=NextCourse(9.0, -2.5, 0.0, -300.0))),
        (start(), Intent(0.3, 0.0, then=NextCourse(7.0, 0.4, 0.0, -300.0, 0.1 - math.tau))),
    ]
    together = model.positions(courses(pairs), TIMES_S)
    assert together.shape == (len(pairs), len(TIMES_S), 3)
    for n, pair in enumerate(pairs):
        assert np.abs(together[n] - model.positions(courses([pair]), TIMES_S)[0]).max() < 1e-3
    times = np.array([3.0, 12.0, 20.0, 30.0, 40.0])
    states = model.states(courses(pairs), times)
    own = model.positions(courses(pairs), times[:, None])
    for n, state in enumerate(states):
        assert state.position_ned_m == pytest.approx(together[n][int(times[n])], abs=1e-3)
        assert own[n, 0] == pytest.approx(together[n][int(times[n])], abs=1e-3)
        assert abs(state.heading_rad) <= math.pi


@each
def test_what_is_next_is_flown_from_then_on_and_the_way_that_is_told(name: str) -> None:
    model, times = model_of(name), np.arange(0.0, 60.0, 0.5)
    nearly_round = NextCourse(10.0, 0.2, 0.0, -300.0, math.tau - 0.1)
    (path,) = model.positions(courses([(start(), Intent(0.3, 0.0, then=nearly_round))]), times)
    steps = np.diff(path, axis=0)
    assert np.linalg.norm(steps, axis=1).max() <= 25.0 * 0.5 * (1.0 + 1e-6)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert headings[:19] == pytest.approx(0.3)
    assert headings[-1] == pytest.approx(0.2 + math.tau, abs=1e-3)


@each
def test_its_uav_flies_a_plan_with_turns_and_climbs(name: str) -> None:
    waypoints = ((800.0, 600.0, -320.0), (-600.0, 900.0, -290.0), (0.0, -1500.0, -300.0))
    uav = Uav(1, (0.0, 0.0, -300.0), 0.0, waypoints)
    scenario = Scenario("plan", 400.0, uav=(uav,), performance=models()[name]())
    arrival_ns = planned_flight(uav, scenario).arrival_ns
    assert arrival_ns is not None
    assert arrival_ns < 300e9


@each
def test_values_that_cannot_be_are_named_with_their_key(name: str) -> None:
    chosen: dict[str, Any] = {"performance.vehicle": name}
    plain = load_scenario("head_on", chosen)
    assert type(plain.performance) is models()[name]
    assert not list(plain.performance.validate(25.0))
    for field in msgspec.structs.fields(plain.performance):
        assert not field.required
        with pytest.raises(ScenarioError, match=f"performance.{field.name}: "):
            load_scenario("head_on", chosen | {f"performance.{field.name}": -1.0})


@each
def test_speeds_stay_near_cruise_speed(name: str) -> None:
    low, high = models()[name]().speeds_mps(20.0)
    assert LEAST_AIRSPEED_MPS <= low <= 20.0 <= high


def test_a_class_that_leaves_something_out_is_refused() -> None:
    class NoModel(Performance, frozen=True, tag="no_model"):
        """Says nothing."""

    class NoDefault(Performance, frozen=True, tag="no_default"):
        """Has a key that must be given."""

        key: float

    class Twin(Performance, frozen=True, tag="point_mass"):
        """Has the name of another."""

        def model(self, level_off_s: float) -> VehicleModel:
            raise AssertionError(level_off_s)

    for cls, why in ((NoModel, "what model"), (NoDefault, "default of key"), (Twin, "another")):
        with pytest.raises(TypeError, match=why):
            vehicle_model(cls)


def test_a_mixed_fleet_is_predicted_row_by_row() -> None:
    slow = {"uav.2.performance.max_bank_deg": 10}
    scenario = load_scenario("four_way", slow)
    usual, other, fleet = scenario.model(1), scenario.model(2), scenario.models()
    uavs, states = [1, 2, 4], [start(20.0), start(25.0), start(30.0)]
    intents = [Intent(1.0, 0.0), Intent(-1.0, 2.0, -350.0), Intent(0.3, 0.0, speed_mps=25.0)]
    alone = [courses([pair]) for pair in zip(states, intents, strict=True)]
    flown_by = [usual, other, usual]
    ages = np.array([1.0, 2.0, 3.0])
    for times in (TIMES_S, ages[:, None] + TIMES_S):
        paths: Array = fleet.positions(uavs, states, intents, times)
        for n, (model, course) in enumerate(zip(flown_by, alone, strict=True)):
            own = times if times.ndim == 1 else times[n]
            assert paths[n] == pytest.approx(model.positions(course, own)[0], abs=1e-9)
    later = fleet.states(uavs, states, intents, ages)
    for n, (model, course) in enumerate(zip(flown_by, alone, strict=True)):
        (expected,) = model.states(course, ages[n : n + 1])
        assert later[n].position_ned_m == pytest.approx(expected.position_ned_m, abs=1e-9)
