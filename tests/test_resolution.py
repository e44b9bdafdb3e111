"""The geometric resolver beyond the packaged encounters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.resolution import GeometricResolver, sector_of
from agents.resolvers import Advice, Aircraft, Situation, load_resolver
from fleet.model.flight import State
from fleet.model.guidance import Plan
from fleet.model.risk import normalised_separation
from fleet.model.scenario import Resolution, Scenario, Uav, Zone
from fleet.model.tracks import Escape, aim_of, courses_of
from fleet.model.trajectory import Aim

ANYBODY = Uav(1, (0.0, 0.0, -300.0), 0.0, ((9000.0, 0.0, -300.0),))
SCENARIO = Scenario("test", 60.0, uav=(ANYBODY,), resolution=Resolution(horizon_s=40.0))


def craft(
    uav: int,
    north_m: float,
    east_m: float,
    heading_deg: float,
    *,
    down_m: float = -300.0,
    climb_mps: float = 0.0,
    escape: Escape | None = None,
) -> Aircraft:
    """An aircraft that flies straight on; its guidance may climb without end."""
    heading = math.radians(heading_deg)
    path = math.asin(climb_mps / 25.0)
    far = (north_m + 9e5 * math.cos(heading), east_m + 9e5 * math.sin(heading), down_m)
    level = math.nan if climb_mps else down_m
    state = State(north_m, east_m, down_m, 25.0, heading, path)
    return Aircraft(uav, state, Aim(heading, climb_mps, level), escape, Plan((far,)))


def resolve(*aircraft: Aircraft, computing: int = 1) -> dict[int, Advice]:
    """One round for all of them."""
    members = tuple(a.id for a in aircraft)
    advice = GeometricResolver(SCENARIO).resolve(Situation(computing, members, aircraft))
    return {a.target: a for a in advice}


def least(aircraft: tuple[Aircraft, ...], advice: dict[int, Advice], end_s: float = 60.0) -> float:
    """Least normalised separation when everybody does as advised, from the prediction."""
    times = np.arange(0.0, end_s, 0.5)
    aims = []
    for a in aircraft:
        told = advice.get(a.id)
        escape = Escape(told.manoeuvre, told.heading_rad, told.climb_mps) if told else a.escape
        aims.append(aim_of(a.guidance, escape))
    course = courses_of([a.state for a in aircraft], aims)
    paths = SCENARIO.predictor().positions(course, times)
    apart = [
        normalised_separation(paths[i] - paths[j], SCENARIO.required()).min()
        for i in range(len(paths))
        for j in range(i)
    ]
    return float(min(apart))


@pytest.mark.parametrize(
    ("angle_deg", "sector"),
    [
        (-30.0, "head_on"),
        (0.0, "head_on"),
        (29.9, "head_on"),
        (30.0, "right"),
        (149.9, "right"),
        (150.0, "rear"),
        (180.0, "rear"),
        (-150.1, "rear"),
        (-150.0, "left"),
        (-30.1, "left"),
    ],
)
def test_sectors_begin_and_end_where_the_paper_says(angle_deg: float, sector: str) -> None:
    assert sector_of(math.radians(angle_deg)) == sector


def test_a_climb_is_measured_from_what_guidance_wants() -> None:
    """Eq. 11: the cost is |Hc - cc|, so a UAV that climbs is told the nearest safe climb."""
    own = craft(1, 0.0, -800.0, 90.0)
    intruder = craft(2, -800.0, 0.0, 0.0, down_m=-260.0, climb_mps=3.0)
    advice = resolve(own, intruder)[2]
    assert (advice.manoeuvre, advice.sector) == ("climb", "right")
    safe = []
    for cc in range(-5, 6):
        told = Advice(2, "climb", climb_mps=float(cc))
        if least((own, intruder), {2: told}, 80.0) >= 1.06:
            safe.append(cc)
    assert advice.climb_mps == min(safe, key=lambda cc: abs(3.0 - cc))


def test_level_flight_is_an_option_for_a_uav_that_climbs() -> None:
    own = craft(1, 0.0, -800.0, 90.0)
    intruder = craft(2, -800.0, 0.0, 0.0, down_m=-240.0, climb_mps=2.0)
    advice = resolve(own, intruder)[2]
    assert advice.manoeuvre == "climb"
    assert advice.climb_mps <= 0.0


def test_overlapping_zones_are_driven_apart() -> None:
    """Two UAVs side by side, 100 m apart: what one is told must open the distance."""
    pair = (craft(1, 0.0, 0.0, 0.0), craft(2, 0.0, 100.0, 0.0))
    advice = resolve(*pair)
    assert advice[2].stage == "least_bad"
    times = np.array([0.0, 30.0])
    aims = []
    for a in pair:
        told = advice.get(a.id)
        flown = Escape(told.manoeuvre, told.heading_rad, told.climb_mps) if told else None
        aims.append(aim_of(a.guidance, flown))
    paths = SCENARIO.predictor().positions(courses_of([a.state for a in pair], aims), times)
    now, later = normalised_separation(paths[0] - paths[1], SCENARIO.required())
    assert now < 0.3
    assert later > 1.0


def test_a_safe_escape_is_kept_and_ends_when_guidance_is_free() -> None:
    turning = Escape("turn", math.radians(-60.0), 0.0)
    own = craft(1, 0.0, -900.0, 90.0)
    assert resolve(own, craft(2, 0.0, 900.0, -90.0, escape=turning))[2].manoeuvre == "keep"
    assert resolve(own, craft(2, 900.0, -1500.0, -90.0, escape=turning))[2].manoeuvre == "resume"


def test_nobody_in_conflict_is_told_anything() -> None:
    assert resolve(craft(1, 0.0, 0.0, 0.0), craft(2, 0.0, 5000.0, 0.0)) == {}


def test_no_option_takes_a_uav_below_the_least_altitude() -> None:
    own = craft(1, 0.0, -1000.0, 90.0, down_m=-20.0)
    advice = resolve(own, craft(2, -1000.0, 0.0, 0.0, down_m=-20.0))
    assert advice[2].climb_mps > 0.0


@given(
    st.integers(2, 5),
    st.floats(-180.0, 180.0),
    st.lists(st.floats(0.0, 25.0), min_size=5, max_size=5),
)
@settings(deadline=None, derandomize=True, max_examples=25)
def test_what_is_called_safe_is_safe(count: int, turned_deg: float, jitter: list[float]) -> None:
    """Random encounters: unless reported as unresolved, the advice keeps everybody apart."""
    aircraft = []
    for n in range(count):
        bearing = math.radians(turned_deg + 360.0 / count * n)
        radius = 1000.0 + 10.0 * jitter[n]
        north, east = radius * math.cos(bearing), radius * math.sin(bearing)
        heading = math.degrees(bearing) + 180.0 + 0.2 * jitter[n]
        aircraft.append(craft(n + 1, north, east, heading))
    advice = resolve(*aircraft)
    if not any(a.stage in ("least_bad", "priority") for a in advice.values()):
        assert least(tuple(aircraft), advice) >= 1.0


def test_zones_of_the_scenario_are_those_that_are_kept() -> None:
    wide = Scenario("test", 60.0, uav=(ANYBODY,), zone=Zone(400.0, 50.0))
    assert wide.required().horizontal_m == 800.0


@pytest.mark.parametrize(
    "name", ["nope", "no.such.module:Thing", "math:pi", "fleet.model.scenario:Nothing"]
)
def test_a_resolver_that_cannot_be_had_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="resolver"):
        load_resolver(Scenario("test", 60.0, resolver=name, uav=(ANYBODY,)))
