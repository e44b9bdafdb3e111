"""What is predicted of a course does not depend on who else is predicted: to the last bit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import astuple

from fleet.model.conflict.blocks import first_overlaps_s, least_separations
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required, sample_times
from fleet.model.conflict.tracks import ActiveManoeuvre, StateReport
from fleet.model.elementary import asin, sin, sincos
from fleet.model.types import Array
from fleet.model.vehicle.courses import Courses, courses
from fleet.model.vehicle.fleet_models import FleetModels
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent, NextCourse
from fleet.model.vehicle.model import VehicleModel
from fleet.model.vehicle.models.point_mass import FEW_COURSES, PointMassPerformance
from fleet.model.vehicle.registry import models
from fleet.model.vehicle.stepped import SteppedModel

POINT_MASS = PointMassPerformance().model(3.0)


@dataclass(frozen=True, slots=True)
class Slowing(SteppedModel):
    """A model in steps, that comes to what it is told by a part of it in each."""

    def advance(self, states: Array, setpoints: Array, dt_s: float) -> Array:
        after = states.copy()
        after[:, 3] += 0.2 * (setpoints[:, 2] - states[:, 3])
        after[:, 4] += 0.1 * (setpoints[:, 0] - states[:, 4])
        after[:, 5] += 0.2 * (asin(setpoints[:, 1] / 50.0) - states[:, 5])
        sine, cosine = sincos(after[:, 4])
        after[:, 0] += dt_s * after[:, 3] * cosine
        after[:, 1] += dt_s * after[:, 3] * sine
        after[:, 2] -= dt_s * after[:, 3] * sin(after[:, 5])
        return after


MODELS = {name: performance().model(3.0) for name, performance in models().items()}
MODELS["slowing"] = Slowing(POINT_MASS.limits, 3.0)
TIMES_S = sample_times(40.0, 1.0)
REQUIRED = Required(402.0, 51.0)
OUTLOOK = Outlook(FleetModels(POINT_MASS), TIMES_S, REQUIRED)
NOW_NS = 7_000_000_000
each = pytest.mark.parametrize("name", MODELS)
tried = settings(deadline=None, derandomize=True, max_examples=15)

Pair = tuple[State, Intent]

HEADINGS = st.floats(-math.pi, math.pi)
LITTLE = st.sampled_from([0.0, 0.0, 1e-16, -3e-16, 1e-9, -9e-8, 1.1e-7, 1e-3])
"""Around what is no turn, no climb and no change of speed."""


@st.composite
def aimed(draw: st.DrawFn) -> Pair:
    """A course: straight, or nearly, or one that turns, climbs, speeds up or bends."""
    down, heading = draw(st.floats(-400.0, -200.0)), draw(HEADINGS)
    speed = draw(st.floats(12.0, 40.0))
    path = draw(st.one_of(LITTLE, st.floats(-0.25, 0.25)))
    to = heading + draw(st.one_of(LITTLE, st.floats(-4.0, 4.0)))
    climb = draw(st.one_of(LITTLE, st.floats(-6.0, 6.0)))
    level = draw(st.one_of(st.just(math.nan), LITTLE.map(down.__add__), st.floats(-450.0, -150.0)))
    told = draw(st.sampled_from([math.nan, speed, speed + 5e-7, speed + 2e-6, 13.0, 38.0]))
    then = draw(st.one_of(st.none(), changes(speed, level)))
    place = (draw(st.floats(-3e3, 3e3)), draw(st.floats(-3e3, 3e3)), down)
    return State(*place, speed, heading, path), Intent(to, climb, level, then, told)


def changes(speed_mps: float, level_down_m: float) -> st.SearchStrategy[NextCourse]:
    """What a course changes to."""
    return st.builds(
        NextCourse,
        st.floats(0.0, 60.0),
        HEADINGS,
        st.floats(-4.0, 4.0),
        st.sampled_from([level_down_m, -310.0]),
        st.sampled_from([0.0, 4.0, -4.0]),
        st.sampled_from([math.nan, speed_mps, speed_mps + 5e-7, speed_mps + 2e-6, 20.0]),
    )


BATCHES = st.lists(aimed(), min_size=2, max_size=FEW_COURSES + 4)


@st.composite
def parts(draw: st.DrawFn) -> tuple[list[Pair], list[int]]:
    """A batch, and places of a part of it in any order."""
    batch = draw(BATCHES)
    order = draw(st.permutations(range(len(batch))))
    return batch, list(order[: draw(st.integers(1, len(batch)))])


def nearly(aside_rad: float, off_m: float = 0.0, then_mps: float = math.nan) -> Pair:
    """Straight on and level at 25 m/s but for this, with a bend after 20 s."""
    then = NextCourse(20.0, 1.0, 0.0, -300.0, 0.0, then_mps)
    state = State(10.0, 20.0, -300.0 + off_m, 25.0, 0.4)
    return state, Intent(0.4 + aside_rad, 0.0, -300.0, then, 25.0)


NEARLY = [
    nearly(9e-8),
    nearly(-1e-9),
    nearly(3e-8, 9e-8),
    nearly(0.0, -1e-8),
    nearly(0.0, 0.0, 25.0 + 5e-7),
]
"""So little is none: also beside one that turns, one that climbs, and one that bends faster."""

AMONG = [*NEARLY, nearly(1.0), nearly(0.0, 20.0), nearly(0.0, 0.0, 30.0)]


def bits(values: Array) -> bytes:
    return np.ascontiguousarray(values).tobytes()


def state_bits(states: list[State]) -> list[tuple[str, ...]]:
    return [tuple(value.hex() for value in astuple(state)) for state in states]


def of(batch: list[Pair], which: list[int]) -> Courses:
    return courses(batch[k] for k in which)


@each
@tried
@example((AMONG, [0, 1]))
@example((AMONG, [2, 3]))
@example((AMONG, [4]))
@given(parts())
def test_a_part_of_a_batch_flies_as_in_the_whole(
    name: str, drawn: tuple[list[Pair], list[int]]
) -> None:
    (batch, which), model = drawn, MODELS[name]
    for told in (VehicleModel.positions, VehicleModel.places, VehicleModel.predict):
        ask = getattr(model, told.__name__)
        assert bits(ask(of(batch, which), TIMES_S)) == bits(ask(courses(batch), TIMES_S)[which])


@each
@tried
@given(parts(), st.lists(st.floats(0.0, 80.0), min_size=12, max_size=12))
def test_times_of_their_own_change_nothing(
    name: str, drawn: tuple[list[Pair], list[int]], ages: list[float]
) -> None:
    """Each course at its own times, fewer or more of them, as alone at all."""
    (batch, which), model = drawn, MODELS[name]
    times = np.array(ages)[: len(batch), None] + TIMES_S
    whole = model.positions(courses(batch), times)
    assert bits(model.positions(of(batch, which), times[which])) == bits(whole[which])
    for k, times_s in enumerate(times):
        assert bits(model.positions(of(batch, [k]), times_s[3:9])) == bits(whole[k : k + 1, 3:9])


@each
@tried
@example((AMONG, [0, 1, 2, 3, 4]), [7.3, 31.0] * 6)
@given(parts(), st.lists(st.sampled_from([0.0, 0.4, 7.3, 31.0, 75.0]), min_size=12, max_size=12))
def test_states_are_those_of_each_alone(
    name: str, drawn: tuple[list[Pair], list[int]], ages: list[float]
) -> None:
    (batch, which), model, times = drawn, MODELS[name], np.array(ages)
    whole = state_bits(model.states(courses(batch), times[: len(batch)]))
    assert state_bits(model.states(of(batch, which), times[which])) == [whole[k] for k in which]
    alone = [model.states(of(batch, [k]), times[k : k + 1]) for k in range(len(batch))]
    assert [state_bits(states)[0] for states in alone] == whole


@tried
@given(parts(), BATCHES)
def test_what_is_found_of_two_trajectories_is_found_among_many(
    drawn: tuple[list[Pair], list[int]], others: list[Pair]
) -> None:
    batch, which = drawn
    paths, far = (POINT_MASS.positions(courses(b), TIMES_S) for b in (batch, others))
    first = first_overlaps_s(paths[:, None], far, TIMES_S, REQUIRED)
    part = first_overlaps_s(paths[which][:, None], far, TIMES_S, REQUIRED)
    assert bits(part) == bits(first[which])
    pairs = [[least_separations(p[None], f[None], REQUIRED)[0] for f in far] for p in paths]
    assert bits(least_separations(paths, far, REQUIRED)) == bits(np.min(pairs, axis=1))


@st.composite
def heard(draw: st.DrawFn) -> list[StateReport]:
    """Reports of UAVs of all kinds, some with a manoeuvre, up to many enough for boxes."""
    batch = draw(st.lists(aimed(), min_size=3, max_size=16))
    out = []
    for uav, (state, guidance) in enumerate(batch, start=1):
        manoeuvre = draw(
            st.one_of(
                st.none(),
                st.builds(ActiveManoeuvre, st.just("turn"), HEADINGS, st.just(0.0)),
                st.just(ActiveManoeuvre("climb", 0.0, 3.0, -500.0)),
                st.just(ActiveManoeuvre("speed", 0.0, 0.0, speed_mps=33.0)),
            )
        )
        plan = FlightPlan((state.position_ned_m,), state.heading_rad)
        t_ns = NOW_NS - draw(st.integers(0, 3_000_000_000))
        out.append(StateReport(uav, t_ns, state, guidance, plan, manoeuvre))
    return out


@settings(deadline=None, derandomize=True, max_examples=15)
@given(heard())
def test_pairs_at_risk_are_those_of_each_two_alone(reports: list[StateReport]) -> None:
    alone: dict[tuple[int, int], float] = {}
    for two in combinations(reports, 2):
        alone |= conflicts(two, NOW_NS, OUTLOOK)
    assert conflicts(reports, NOW_NS, OUTLOOK) == alone
