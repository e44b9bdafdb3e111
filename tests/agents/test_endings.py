"""When a manoeuvre can end: found for each candidate by itself, on its own way through the plan."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from fleet.agents.advisory import Aircraft
from fleet.agents.geometry import Geometry
from fleet.config.scenario import Resolution, Scenario, Uav
from fleet.model.conflict.risk import first_overlap_s
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent

DOWN_M = -300.0
PLAN = ((600.0, 0.0, DOWN_M), (600.0, 3000.0, DOWN_M))
"""North to a waypoint 24 s ahead, and then east."""
UAV = Uav(1, (0.0, 0.0, DOWN_M), 0.0, PLAN)
SCENARIO = Scenario("endings", 60.0, uav=(UAV,), resolution=Resolution(horizon_s=40.0))
GEOMETRY = Geometry(SCENARIO)
TURNS_RAD = (0.03, -0.8, 0.05, 1.2, -0.02, 0.6)
"""Some pass the waypoint on their way, others do not."""


def ownship() -> Aircraft:
    state, plan = UAV.state(), FlightPlan(PLAN, 0.0)
    pilot = SCENARIO.pilot(1, state.speed_mps)
    return Aircraft(1, state, pilot.intent(plan, state), None, plan)


def traffic(seed: int, count: int = 3) -> list[tuple[int, State, Intent]]:
    """Others who fly straight across."""
    rng = random.Random(seed)
    out = []
    for uav in range(2, 2 + count):
        heading = rng.uniform(-math.pi, math.pi)
        place = rng.uniform(-500.0, 2500.0), rng.uniform(-1500.0, 2500.0)
        out.append((uav, State(*place, DOWN_M, 25.0, heading), Intent(heading, 0.0, DOWN_M)))
    return out


def manoeuvre(turn_rad: float) -> Intent:
    return Intent(turn_rad, 0.0, DOWN_M)


def by_itself(intent: Intent, rest: list[tuple[int, State, Intent]]) -> float:
    """The first whole second at which guidance may take over, by flying each way home alone."""
    craft, times = ownship(), GEOMETRY.outlook.times_s
    model, pilot = SCENARIO.models().of(1), SCENARIO.pilot(1, 25.0)
    plan, before = craft.plan, None
    for end_s in times[:: round(1.0 / times[1])]:
        (state,) = model.states(courses([(craft.state, intent)]), np.array([end_s]))
        plan = pilot.advance(plan, before or state, state)
        before = state
        home = model.positions(courses([(state, pilot.intent(plan, state))]), times)
        uavs, states, intents = (list(column) for column in zip(*rest, strict=True))
        far = SCENARIO.models().positions(uavs, states, intents, times + end_s)
        if np.isinf(first_overlap_s(home - far, times, GEOMETRY.outlook.required)).all():
            return float(end_s)
    return float(times[-1])


@pytest.mark.parametrize("seed", range(12))
def test_a_manoeuvre_ends_when_the_way_home_is_first_free(seed: int) -> None:
    rest = traffic(seed)
    for turn_rad in TURNS_RAD:
        found, _ = GEOMETRY.manoeuvre_times_s(ownship(), manoeuvre(turn_rad), rest)
        assert found == by_itself(manoeuvre(turn_rad), rest)


@pytest.mark.parametrize("count", [13, 20, 40])
@pytest.mark.parametrize("seed", range(4))
def test_among_many_it_is_the_same(seed: int, count: int) -> None:
    rest = traffic(seed, count)
    for turn_rad in TURNS_RAD:
        found, _ = GEOMETRY.manoeuvre_times_s(ownship(), manoeuvre(turn_rad), rest)
        assert found == by_itself(manoeuvre(turn_rad), rest)


def test_the_ends_are_early_late_and_never() -> None:
    ends = {by_itself(manoeuvre(t), traffic(seed)) for seed in range(12) for t in TURNS_RAD}
    assert min(ends) == 0.0
    assert any(8.0 < end < 40.0 for end in ends)
    assert max(ends) == GEOMETRY.outlook.times_s[-1]


@pytest.mark.parametrize("seed", range(12))
def test_whether_a_candidate_can_end_does_not_depend_on_those_beside_it(seed: int) -> None:
    """One that passes a waypoint once left the plan advanced for those that were looked at next."""
    rest, intents = traffic(seed), [manoeuvre(t) for t in TURNS_RAD]
    together = list(GEOMETRY.returning(ownship(), intents, rest, None))
    alone = [next(GEOMETRY.returning(ownship(), [intent], rest, None)) for intent in intents]
    assert together == alone
