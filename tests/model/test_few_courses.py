"""The states of a few courses, one by one, are those of the arrays bit by bit."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from msgspec.structs import astuple

from fleet.config.scenario import Scenario
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.intent import Intent, NextCourse
from fleet.model.vehicle.model import VehicleModel
from fleet.model.vehicle.models import point_mass
from fleet.model.vehicle.models.point_mass import FEW_COURSES
from tests.model.test_detection import MODELS, scene

MODEL = Scenario("few", 100.0).models().of(1)
Pair = tuple[State, Intent]


def course(rng: random.Random, kinds: str) -> Pair:
    """One of these kinds: straight, turning, climbing, levelling off, or a little of all."""
    kind, little = rng.choice(kinds), rng.choice([1e-9, 1e-8, 1e-3, 1.0])
    heading, down = rng.uniform(-math.pi, math.pi), rng.uniform(-400.0, -200.0)
    to, climb, level, path = heading, 0.0, rng.choice([down, math.nan]), 0.0
    if kind in "ta":
        to = rng.choice([heading + little * rng.uniform(-1.0, 1.0), rng.uniform(-3.5, 3.5)])
    if kind in "cla":
        climb = rng.choice([0.0, little * rng.uniform(-1.0, 1.0), rng.uniform(-8.0, 8.0)])
        path = rng.choice([0.0, little * rng.uniform(-0.1, 0.1), rng.uniform(-0.3, 0.3)])
    if kind in "la":
        level = down + rng.choice([0.0, little * rng.uniform(-1.0, 1.0), rng.uniform(-90.0, 90.0)])
    place = (rng.uniform(-5000.0, 5000.0), rng.uniform(-5000.0, 5000.0), down)
    then = NextCourse(rng.uniform(0.0, 90.0), 1.0, 0.0, down) if rng.random() < 0.2 else None
    return State(*place, rng.uniform(12.0, 40.0), heading, path), Intent(to, climb, level, then)


def bits(states: list[State]) -> list[tuple[str, ...]]:
    return [tuple(value.hex() for value in astuple(state)) for state in states]


@pytest.mark.parametrize("kinds", ["s", "st", "stc", "stcl", "stcla", "a", "cl"])
def test_the_bits_are_those_of_the_arrays(kinds: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(kinds)
    for _ in range(300):
        batch = courses([course(rng, kinds) for _ in range(rng.randint(1, FEW_COURSES))])
        far = rng.choice([0.3, 3.0, 60.0])
        times = np.array([rng.choice([0.0, rng.uniform(0.0, far)]) for _ in range(len(batch))])
        few = MODEL.states(batch, times)
        with monkeypatch.context() as patch:
            patch.setattr(point_mass, "FEW_COURSES", 0)
            assert bits(few) == bits(MODEL.states(batch, times))


def test_a_climb_that_levels_off_is_where_its_equations_have_it() -> None:
    """At 5 m/s for 10 s after the ramp, and the last 5 m/s times 3 s exponentially."""
    state, intent = State(0.0, 0.0, -300.0, 25.0, 0.0), Intent(0.0, 5.0, -400.0)
    (at_20_s,) = MODEL.states(courses([(state, intent)]), np.array([20.0]))
    path = math.asin(5.0 / 25.0)
    ramp_s = path / math.radians(6.0)
    ramp_m = 25.0 / math.radians(6.0) * (1.0 - math.cos(path))
    capture_s = ramp_s + (100.0 - ramp_m - 15.0) / 5.0
    left_m = 15.0 * math.exp(-(20.0 - capture_s) / 3.0) if capture_s < 20.0 else None
    climbed = 100.0 - left_m if left_m else ramp_m + 5.0 * (20.0 - ramp_s)
    assert -at_20_s.down_m - 300.0 == pytest.approx(climbed, abs=1e-6)
    assert at_20_s.climb_mps == pytest.approx(5.0 if left_m is None else left_m / 3.0, abs=1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_one_after_a_time_is_as_among_several(seed: int) -> None:
    """With bends and speeds that change within the time, or do not."""
    rng = random.Random(seed)
    for report in scene(seed, 6, 1500.0):
        model, time_s = MODELS.of(report.id), rng.uniform(0.0, 80.0)
        intent = report.intent()
        (one,) = model.states(courses([(report.state, intent)]), np.array([time_s]))
        assert model.after(report.state, intent, time_s) == one
        climb = course_climb(model, report.state, intent)
        assert model.climb_mps(intent, report.state) == climb


def course_climb(model: VehicleModel, state: State, intent: Intent) -> float:
    """The climb commanded, as for a batch."""
    course = courses([(state, intent)])
    return float(course.climbs_mps(model.levelling_s(course))[0]) + 0.0
