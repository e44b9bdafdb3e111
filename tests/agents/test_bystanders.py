"""Who is left out of a round: what the round comes to is the same to the last bit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fleet.agents.advisory import Advisory, Situation
from fleet.agents.geometric import GeometricResolver
from fleet.agents.group_resolver import GroupResolver, RoundResult
from fleet.config.scenario import Resolution, Scenario, Uav
from fleet.model.conflict.tracks import ActiveManoeuvre, CommandId, StateReport
from fleet.model.election import Mandate
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent, NextCourse
from tests.support.samples import MS, S

ANYBODY = Uav(1, (0.0, 0.0, -300.0), 0.0, ((9000.0, 0.0, -300.0),))
NOW_NS = 100 * S
MEMBERS = (1, 2, 3)


def scenario(growth_mps: float = 0.0, speed_candidates: int = 0) -> Scenario:
    resolution = Resolution(
        horizon_s=30.0, growth_mps=growth_mps, speed_candidates=speed_candidates
    )
    return Scenario("test", 60.0, uav=(ANYBODY,), resolution=resolution)


def flying(
    uav: int,
    north_m: float,
    east_m: float,
    heading_rad: float,
    *,
    age_ns: int = 0,
    down_m: float = -300.0,
    level_down_m: float | None = None,
    aside_rad: float = 0.0,
    then: NextCourse | None = None,
    manoeuvre: ActiveManoeuvre | None = None,
    told_mps: float = 25.0,
) -> StateReport:
    """A report of a UAV that flies straight on at 25 m/s, but for what is said."""
    state = State(north_m, east_m, down_m, 25.0, heading_rad)
    level_down_m = down_m if level_down_m is None else level_down_m
    climb_mps = max(-3.0, min(3.0, (down_m - level_down_m) / 3.0))
    guidance = Intent(heading_rad + aside_rad, climb_mps, level_down_m, then, told_mps)
    far = (north_m + 9e4 * math.cos(heading_rad), east_m + 9e4 * math.sin(heading_rad), down_m)
    plan = FlightPlan((far, far), heading_rad)
    commanded = CommandId(3, 1, uav) if manoeuvre else CommandId()
    return StateReport(uav, NOW_NS - age_ns, state, guidance, plan, manoeuvre, commanded)


GROUP = [flying(1, 0.0, 0.0, 0.0), flying(2, 1300.0, 0.0, math.pi)]


class Whole:
    """The geometric resolver, given everybody."""

    def __init__(self, of: Scenario) -> None:
        self._resolver = GeometricResolver(of)

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        return self._resolver.resolve(situation)


def rounds(of: Scenario, reports: Sequence[StateReport], *, whole: bool) -> list[RoundResult]:
    """Two rounds of UAV 1, the second a little later with the same reports."""
    group_resolver = GroupResolver(1, of, Whole(of) if whole else GeometricResolver(of))
    group_resolver.appoint(Mandate(3, MEMBERS, 1, 200 * S))
    later_ns = NOW_NS + 600 * MS
    own = [msgspec.structs.replace(reports[0], t_ns=now_ns) for now_ns in (NOW_NS, later_ns)]
    return [
        group_resolver.run_round(own[0], reports[1:], NOW_NS),
        group_resolver.run_round(own[1], reports[1:], later_ns),
    ]


HEADINGS = st.floats(-math.pi, math.pi)
COURSES = st.builds(
    NextCourse,
    st.floats(0.0, 300.0),
    HEADINGS,
    st.just(0.0),
    st.just(-300.0),
    st.just(0.0),
    st.sampled_from([25.0, 25.0 + 1e-5]),
)
MANOEUVRES = st.one_of(
    st.builds(ActiveManoeuvre, st.just("turn"), HEADINGS, st.just(0.0)),
    st.builds(ActiveManoeuvre, st.just("climb"), st.just(0.0), st.just(3.0), st.just(-400.0)),
)
CHANGES = st.fixed_dictionaries(
    {"age_ns": st.integers(0, 5000).map(lambda age: age * MS)},
    optional={
        "level_down_m": st.sampled_from([-300.0, -300.0 + 1e-9, -350.0]),
        "aside_rad": st.sampled_from([1e-15, 1e-9, 4e-8, 1e-7, 1e-3, 2.0]),
        "then": COURSES,
        "manoeuvre": MANOEUVRES,
        "told_mps": st.sampled_from([25.0, 25.0 + 4e-7, 25.0 + 2e-6, 30.0]),
    },
)
PLACES = st.one_of(st.floats(-9000.0, 9000.0), st.floats(-3000.0, 3000.0))
CHANGED: st.SearchStrategy[dict[str, Any]] = st.one_of(
    CHANGES, st.just({}), st.just({"aside_rad": 4e-8})
)


@st.composite
def traffic(draw: st.DrawFn) -> list[StateReport]:
    """Two that meet head-on, a third anywhere near, and up to ten others anywhere at all."""
    group = [
        flying(1, 0.0, 0.0, 0.0),
        flying(2, 1300.0, draw(st.floats(-100.0, 100.0)), math.pi, **draw(CHANGED)),
        flying(3, draw(st.floats(-900.0, 900.0)), 400.0, draw(HEADINGS), **draw(CHANGED)),
    ]
    count = draw(st.integers(1, 10))
    places = [(draw(PLACES), draw(PLACES), draw(HEADINGS)) for _ in range(count)]
    return group + [flying(4 + n, *place, **draw(CHANGED)) for n, place in enumerate(places)]


def barely_turning(far: StateReport) -> list[StateReport]:
    """A group that flies straight on but for rounding, and somebody far away."""
    return [
        flying(1, 0.0, 0.0, 0.0, aside_rad=4e-8),
        flying(2, 1300.0, 30.0, math.pi, aside_rad=4e-8, age_ns=500 * MS),
        flying(3, 300.0, 700.0, 2.0, aside_rad=3e-8),
        far,
    ]


@settings(max_examples=100, deadline=None)
@example(barely_turning(flying(4, 0.0, 9000.0, 0.0, aside_rad=1.0)), (0.0, 0))
@example(barely_turning(flying(4, 0.0, 9000.0, 0.0, level_down_m=-350.0)), (0.0, 0))
@example(barely_turning(flying(4, 0.0, 9000.0, 0.0)), (0.0, 0))
@example([*GROUP, flying(4, 650.0, 3000.0, -0.5 * math.pi)], (0.0, 0))
@example(
    [*GROUP, flying(4, 0.0, 9000.0, 0.0, age_ns=200 * S), flying(5, 0.0, 3900.0, 0.0)], (3.0, 0)
)
@given(traffic(), st.sampled_from([(0.0, 0), (3.0, 0), (0.0, 3)]))
def test_a_round_comes_to_the_same_without_bystanders(
    reports: list[StateReport], how: tuple[float, int]
) -> None:
    of = scenario(*how)
    assert repr(rounds(of, reports, whole=False)) == repr(rounds(of, reports, whole=True))


def left(*others: StateReport, of: Scenario | None = None) -> list[int]:
    """IDs of those who are left in a round of the head-on group."""
    start_ns = NOW_NS + 200 * MS
    selected = GeometricResolver(of or scenario()).concerned(
        [*GROUP, *others], {1, 2}, NOW_NS, start_ns
    )
    return [r.id for r in selected]


def test_one_far_away_is_left_out() -> None:
    """2 T_s are 60 s, in which two at 25 m/s come 3000 m nearer; the zones are 2 * 50 m."""
    zones_m = scenario().required().horizontal_m
    reach_m = 2 * 25.0 * 60.2 + zones_m
    assert left(flying(4, 0.0, reach_m - 5.0, 0.0), flying(5, 0.0, reach_m + 20.0, 0.0)) == [
        1,
        2,
        4,
    ]


@pytest.mark.parametrize(
    "other",
    [
        flying(4, 0.0, 8000.0, 0.0, aside_rad=0.1),
        flying(4, 0.0, 8000.0, 0.0, level_down_m=-310.0),
        flying(4, 0.0, 8000.0, 0.0, told_mps=28.0),
        flying(4, 0.0, 8000.0, 0.0, then=NextCourse(30.0, 1.0, 0.0, -300.0, 0.0, 25.0)),
        flying(4, 0.0, 8000.0, 0.0, manoeuvre=ActiveManoeuvre("turn", 1.0, 0.0)),
    ],
    ids=["turns", "climbs", "speeds up", "turns soon", "manoeuvres"],
)
def test_so_is_one_far_away_that_bends_its_way(other: StateReport) -> None:
    assert left(other) == [1, 2]


def test_the_oldest_report_stays_where_zones_grow_with_it() -> None:
    old = flying(4, 0.0, 8000.0, 0.0, age_ns=9 * S)
    assert left(old, flying(5, 0.0, 8000.0, 0.0)) == [1, 2]
    assert left(old, flying(5, 0.0, 8000.0, 0.0), of=scenario(growth_mps=1.0)) == [1, 2, 4]
