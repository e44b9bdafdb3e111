"""The geometric resolver beyond the packaged encounters."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fleet.agents.advisory import Advisory, Aircraft, Situation
from fleet.agents.candidates import Levels
from fleet.agents.geometric import GeometricResolver
from fleet.agents.geometry import Geometry, Others
from fleet.agents.resolvers import load_resolver
from fleet.agents.sectors import sector_of
from fleet.config.scenario import Resolution, Scenario, Uav, Zone
from fleet.model.conflict.risk import Required, normalised_separation
from fleet.model.conflict.tracks import ActiveManoeuvre, intent_of
from fleet.model.types import Array
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent
from fleet.protocol.surveillance import manoeuvre_of

ANYBODY = Uav(1, (0.0, 0.0, -300.0), 0.0, ((9000.0, 0.0, -300.0),))
SCENARIO = Scenario("test", 60.0, uav=(ANYBODY,), resolution=Resolution(horizon_s=40.0))
REQUIRED = SCENARIO.required()


def craft(
    uav: int,
    north_m: float,
    east_m: float,
    heading_deg: float,
    *,
    down_m: float = -300.0,
    climb_mps: float = 0.0,
    manoeuvre: ActiveManoeuvre | None = None,
    age_s: float = 0.0,
) -> Aircraft:
    """An aircraft that flies straight on; its guidance may climb without end."""
    heading = math.radians(heading_deg)
    path = math.asin(climb_mps / 25.0)
    far = (north_m + 9e5 * math.cos(heading), east_m + 9e5 * math.sin(heading), down_m)
    level = math.nan if climb_mps else down_m
    state = State(north_m, east_m, down_m, 25.0, heading, path)
    return Aircraft(
        uav, state, Intent(heading, climb_mps, level), manoeuvre, FlightPlan((far,), heading), age_s
    )


def resolve(*aircraft: Aircraft, scenario: Scenario = SCENARIO) -> dict[int, Advisory]:
    """One round for all of them; UAV 1 computes."""
    members = tuple(a.id for a in aircraft)
    advisory = GeometricResolver(scenario).resolve(Situation(1, members, aircraft))
    return {a.target: a for a in advisory}


def manoeuvre_advised(told: Advisory) -> ActiveManoeuvre:
    return manoeuvre_of(told.manoeuvre, told.heading_rad, told.climb_mps, told.level_down_m)


def least(
    aircraft: tuple[Aircraft, ...],
    advisory: dict[int, Advisory],
    end_s: float = 60.0,
    required: Required = REQUIRED,
) -> float:
    """Least normalised separation when everybody does as advised, from the prediction."""
    times = np.arange(0.0, end_s, 0.1)
    intents = []
    for a in aircraft:
        told = advisory.get(a.id)
        manoeuvre = manoeuvre_advised(told) if told else a.manoeuvre
        intents.append(intent_of(a.guidance, manoeuvre))
    uavs, states = [a.id for a in aircraft], [a.state for a in aircraft]
    paths = SCENARIO.models().positions(uavs, states, intents, times)
    apart = [
        normalised_separation(paths[i] - paths[j], required).min()
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
    assert sector_of(math.radians(angle_deg), Resolution()) == sector


def test_a_climb_is_measured_from_what_guidance_wants() -> None:
    """Eq. 11: the cost is |Hc - cc|, so a UAV that climbs is told the nearest safe climb."""
    own = craft(1, 0.0, -800.0, 90.0)
    intruder = craft(2, -800.0, 0.0, 0.0, down_m=-260.0, climb_mps=3.0)
    advisory = resolve(own, intruder)[2]
    assert (advisory.manoeuvre, advisory.sector) == ("climb", "right")
    safe = []
    for cc in range(-5, 6):
        told = Advisory(2, "climb", climb_mps=float(cc))
        if least((own, intruder), {2: told}, 80.0) >= 1.06:
            safe.append(cc)
    assert advisory.climb_mps == min(safe, key=lambda cc: abs(3.0 - cc))


def test_a_uav_that_climbs_may_level_off_below() -> None:
    """UAV 1 is at 300 m: below 250 m, the margin and 1 m off that is out of its way."""
    own = craft(1, 0.0, -800.0, 90.0)
    intruder = craft(2, -800.0, 0.0, 0.0, down_m=-240.0, climb_mps=2.0)
    advisory = resolve(own, intruder)[2]
    assert advisory.manoeuvre == "climb"
    assert advisory.climb_mps == 2.0
    assert -247.5 <= advisory.level_down_m <= -245.0


def test_overlapping_zones_are_driven_apart() -> None:
    """Two UAVs side by side, 100 m apart: what one is told must open the distance."""
    pair = (craft(1, 0.0, 0.0, 0.0), craft(2, 0.0, 100.0, 0.0))
    advisory = resolve(*pair)
    assert advisory[2].stage == "least_bad"
    times = np.array([0.0, 30.0])
    intents = []
    for a in pair:
        told = advisory.get(a.id)
        flown = manoeuvre_advised(told) if told else None
        intents.append(intent_of(a.guidance, flown))
    uavs, states = [a.id for a in pair], [a.state for a in pair]
    paths = SCENARIO.models().positions(uavs, states, intents, times)
    now, later = normalised_separation(paths[0] - paths[1], SCENARIO.required())
    assert now < 0.3
    assert later > 1.0


def test_a_safe_manoeuvre_is_kept_and_ends_when_guidance_is_free() -> None:
    turning = ActiveManoeuvre("turn", math.radians(-60.0), 0.0)
    own = craft(1, 0.0, -900.0, 90.0)
    assert resolve(own, craft(2, 0.0, 900.0, -90.0, manoeuvre=turning))[2].manoeuvre == "keep"
    assert resolve(own, craft(2, 900.0, -1500.0, -90.0, manoeuvre=turning))[2].manoeuvre == "resume"


def test_nobody_in_conflict_is_told_anything() -> None:
    assert resolve(craft(1, 0.0, 0.0, 0.0), craft(2, 0.0, 5000.0, 0.0)) == {}


def test_no_option_takes_a_uav_below_the_least_altitude() -> None:
    own = craft(1, 0.0, -1000.0, 90.0, down_m=-20.0)
    advisory = resolve(own, craft(2, -1000.0, 0.0, 0.0, down_m=-20.0))
    assert advisory[2].climb_mps > 0.0


@given(
    st.integers(2, 5),
    st.floats(-180.0, 180.0),
    st.lists(st.floats(0.0, 25.0), min_size=5, max_size=5),
)
@settings(deadline=None, derandomize=True, max_examples=25)
def test_what_is_called_safe_is_safe(count: int, turned_deg: float, jitter: list[float]) -> None:
    """Random encounters: unless reported as unresolved, the advisories keep all apart for T_s."""
    aircraft = []
    for n in range(count):
        bearing = math.radians(turned_deg + 360.0 / count * n)
        radius = 1000.0 + 10.0 * jitter[n]
        north, east = radius * math.cos(bearing), radius * math.sin(bearing)
        heading = math.degrees(bearing) + 180.0 + 0.2 * jitter[n]
        aircraft.append(craft(n + 1, north, east, heading))
    advisory = resolve(*aircraft)
    if not any(a.unresolved for a in advisory.values()):
        assert least(tuple(aircraft), advisory, 40.0) >= 1.0


def test_who_is_tried_again_keeps_clear_of_what_the_computing_uav_flies_by_then() -> None:
    """UAV 2 has nowhere to go, 1 makes way; what is told of 2 is what both will do to each other.

    Both fly through one point 335 m ahead of them, 13.4 s away.
    """
    pair = (
        craft(1, 0.0, -335.0, 90.0, down_m=-1000.0),
        craft(2, -335.0, 0.0, 0.0, down_m=-1000.0),
    )
    advisory = resolve(*pair)
    assert advisory[1].stage == "own"
    told = least(pair, advisory, 80.0)
    assert told == pytest.approx(advisory[2].least_separation, abs=0.01)
    assert told == pytest.approx(advisory[1].least_separation, abs=0.01)
    assert told > 1.0
    assert not advisory[2].unresolved


def test_what_stays_in_conflict_is_unresolved_at_whatever_stage() -> None:
    """Four UAVs with little or no time left: what is told is true of the round's end."""
    seen = set()
    for radius_m in range(150, 800, 50):
        crafts = tuple(meeting(4, 20.0, float(radius_m), 0.0))
        advisory = resolve(*crafts, scenario=growing(0.0))
        for target, told in advisory.items():
            rest = {a.id: a for a in crafts}
            apart = min(least((rest[target], rest[o]), advisory, 80.0) for o in rest if o != target)
            assert told.least_separation == pytest.approx(apart, abs=0.01)
            seen.add((told.stage, told.unresolved))
    assert {("least_bad", True), ("priority", True)} < seen
    assert {unresolved for _, unresolved in seen} == {True, False}


def test_zones_of_the_scenario_are_those_that_are_kept() -> None:
    wide = Scenario("test", 60.0, uav=(ANYBODY,), zone=Zone(400.0, 50.0))
    assert wide.required().horizontal_m == 800.0


@pytest.mark.parametrize(
    "name", ["nope", "no.such.module:Thing", "math:pi", "fleet.config.scenario:Nothing"]
)
def test_a_resolver_that_cannot_be_had_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="resolver"):
        load_resolver(Scenario("test", 60.0, resolver=name, uav=(ANYBODY,)))


# Growth of the zone with the age of tracks

STANDARD = Zone()


def growing(horizontal_mps: float, vertical_mps: float = 0.0, zone: Zone = STANDARD) -> Scenario:
    """SCENARIO with zones that grow, and so many samples that their widening is next to nothing."""
    rules = Resolution(sample_s=0.25, growth_mps=horizontal_mps, vertical_growth_mps=vertical_mps)
    return Scenario("test", 60.0, uav=(ANYBODY,), resolution=rules, zone=zone)


def meeting(count: int, turned_deg: float, radius_m: float, age_s: float) -> list[Aircraft]:
    """UAVs that would meet within some 100 m of the origin, known with the same age."""
    crafts = []
    for n in range(count):
        bearing = turned_deg + (140.0 - 25.0 * n) * n
        north, east = (radius_m * f(math.radians(bearing)) for f in (math.cos, math.sin))
        crafts.append(craft(n + 1, north, east, bearing + 180.0 + 3.0 * n, age_s=age_s))
    return crafts


ages_s = st.floats(0.0, 5.0)
growths_mps = st.floats(0.0, 60.0)
bearings_deg = st.floats(-180.0, 180.0)


@given(bearings_deg, st.floats(900.0, 1300.0), ages_s, ages_s, growths_mps, st.floats(0.0, 4.0))
@settings(deadline=None, derandomize=True, max_examples=100)
def test_a_manoeuvre_keeps_the_grown_distance_from_an_aged_track(
    turned_deg: float, radius_m: float, own_s: float, other_s: float, wide: float, high: float
) -> None:
    """Whenever a turn or a climb that keeps it exists."""
    own, other = meeting(2, turned_deg, radius_m, 0.0)
    pair = (replace(own, age_s=own_s), replace(other, age_s=other_s))
    age_s = own_s + other_s
    grown = Required(400.0 + wide * age_s, 50.0 + high * age_s)
    assume(least(pair, {}, 40.0, grown) < 1.0)
    heading = other.guidance.heading_rad
    turns = [Advisory(2, "turn", heading + math.radians(15.0 * k)) for k in range(-6, 7)]
    climbs = [Advisory(2, "climb", climb_mps=float(k)) for k in range(1, 6)]
    assume(any(least(pair, {2: a}, 80.0, grown) > 1.06 for a in turns + climbs))
    advisory = resolve(*pair, scenario=growing(wide, high))
    assert advisory[2].stage in ("axis", "other", "both")
    assert least(pair, advisory, 80.0, grown) >= 1.0
    assert advisory[2].least_separation == pytest.approx(least(pair, advisory, 80.0), abs=0.02)


@given(
    st.integers(2, 4), bearings_deg, st.floats(350.0, 1800.0), ages_s, growths_mps, st.floats(0, 4)
)
@settings(deadline=None, derandomize=True, max_examples=25)
def test_growth_is_like_a_larger_zone(
    count: int, turned_deg: float, radius_m: float, age_s: float, wide: float, high: float
) -> None:
    """All tests use it; but the least separation is told relative to the zone as it is."""
    crafts = meeting(count, turned_deg, radius_m, age_s)
    larger = Zone(200.0 + wide * age_s, 25.0 + high * age_s)
    found = resolve(*crafts, scenario=growing(wide, high))
    expected = resolve(*crafts, scenario=growing(0.0, zone=larger))
    assert found.keys() == expected.keys()
    for target, advisory in found.items():
        wanted = expected[target]
        begins_s = pytest.approx(wanted.time_to_violation_s, abs=0.05)
        assert advisory.time_to_violation_s == begins_s
        assert (advisory.manoeuvre, advisory.stage) == (wanted.manoeuvre, wanted.stage)
        assert (advisory.heading_rad, advisory.climb_mps) == (wanted.heading_rad, wanted.climb_mps)
        assert advisory.manoeuvre_s == wanted.manoeuvre_s
        assert [c.safe for c in advisory.candidates] == [c.safe for c in wanted.candidates]


@given(st.integers(2, 5), bearings_deg, st.floats(300.0, 1800.0), ages_s)
@settings(deadline=None, derandomize=True, max_examples=10)
def test_nothing_changes_without_growth_or_without_age(
    count: int, turned_deg: float, radius_m: float, age_s: float
) -> None:
    fresh, aged = (meeting(count, turned_deg, radius_m, age) for age in (0.0, age_s))
    expected = resolve(*fresh, scenario=growing(0.0))
    assert resolve(*aged, scenario=growing(0.0)) == expected
    assert resolve(*fresh, scenario=growing(60.0, 4.0)) == expected


def test_the_ages_of_both_add() -> None:
    """Of the computing UAV and a target, and of two targets."""

    def told(*ages: float) -> dict[int, Advisory]:
        places = [(0.0, -1000.0, 90.0), (0.0, 1000.0, -90.0), (50.0, 2500.0, -90.0)]
        crafts = [craft(n + 1, *places[n], age_s=age) for n, age in enumerate(ages)]
        return resolve(*crafts, scenario=growing(40.0))

    assert told(1.0, 3.0) == told(4.0, 0.0) == told(0.0, 4.0) != told(0.0, 3.0)

    def apart(second_s: float, third_s: float) -> dict[int, Advisory]:
        pair = (craft(2, 0.0, 1000.0, -90.0, age_s=second_s), craft(3, 0, -1000, 90, age_s=third_s))
        return resolve(craft(1, 9e4, 0.0, 0.0), *pair, scenario=growing(40.0))

    assert apart(1.0, 3.0) == apart(4.0, 0.0) == apart(0.0, 4.0) != apart(0.0, 3.0)


def test_a_zone_that_has_grown_wide_is_met_from_far_away() -> None:
    """5 km apart, 400 m and 30 s times 100 m/s to keep: the zones meet in (5000 - 3400) / 50 s."""
    pair = (craft(1, 0.0, -2500.0, 90.0), craft(2, 0.0, 2500.0, -90.0, age_s=30.0))
    assert resolve(*pair) == {}
    advisory = resolve(*pair, scenario=growing(100.0))[2]
    assert advisory.time_to_violation_s == pytest.approx(32.0, abs=0.1)


def test_of_grown_zones_that_overlap_already_the_least_bad_is_chosen() -> None:
    """Side by side 600 m apart, which is enough for fresh tracks but not for old ones."""
    pair = (craft(1, 0.0, 0.0, 0.0), craft(2, 0.0, 600.0, 0.0, age_s=5.0))
    assert resolve(*pair) == {}
    advisory = resolve(*pair, scenario=growing(60.0))[2]
    assert (advisory.stage, advisory.least_separation) == ("least_bad", 1.5)


# Where climbs level off


def levels_of(start_down_m: float, *others: tuple[float, float]) -> Levels:
    """For a UAV flying north, and others (east, down) abreast of it."""
    geometry = Geometry(SCENARIO)

    def path(east_m: float, down_m: float) -> Array:
        state = State(0.0, east_m, down_m, 25.0, 0.0, 0.0)
        return np.asarray(
            geometry.positions([1], [state], [Intent(0.0, 0.0, down_m)])[0], dtype=np.float64
        )

    paths = np.stack([path(*other) for other in others])
    return geometry.levels(path(0.0, start_down_m), Others(paths))


KEEP_M = SCENARIO.manoeuvre_outlook().required.vertical_m + 1.0


def test_a_climb_levels_off_clear_of_those_in_the_way() -> None:
    levels = levels_of(-300.0, (50.0, -310.0))
    assert 50.0 < KEEP_M < 55.0
    assert levels.up == pytest.approx((-310.0 - KEEP_M,))
    assert levels.near(2.0)[0] == pytest.approx(-310.0 - KEEP_M)
    assert levels.down == pytest.approx((-310.0 + KEEP_M,))


def test_who_is_above_all_others_climbs_no_further() -> None:
    levels = levels_of(-360.0, (50.0, -300.0))
    assert levels.up == ()
    assert levels.near(3.0) == [pytest.approx(-360.0 - 3.0 * levels.level_off_s)]
    assert levels.down == pytest.approx((-300.0 - KEEP_M, -300.0 + KEEP_M))


def test_a_manoeuvre_that_also_turns_levels_off_clear_of_those_who_are_farther_off() -> None:
    assert levels_of(-300.0, (3000.0, -310.0)).up == pytest.approx((-310.0 - KEEP_M,))
