"""Generated traffic."""

from __future__ import annotations

import math
from itertools import combinations

import pytest

from fleet.config.scenario import Converge, Crossing, Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.errors import TooDenseError


def crossing(seed: int = 1, count: int = 30, density: float = 0.25) -> Scenario:
    table = Crossing(count=count, density_per_km2=density)
    return Scenario("generated", 60.0, seed=seed, generate=table)


def converging(count: int) -> Scenario:
    return Scenario("generated", 60.0, generate=Converge(count=count, radius_m=2000.0))


def test_the_same_seed_gives_the_same_traffic() -> None:
    assert uavs_of(crossing(seed=7)) == uavs_of(crossing(seed=7))


def test_another_seed_gives_other_traffic() -> None:
    one, two = uavs_of(crossing(seed=7)), uavs_of(crossing(seed=8))
    assert all(a.position_ned_m != b.position_ned_m for a, b in zip(one, two, strict=True))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("density", [0.25, 4.0])
def test_no_protected_zones_overlap_at_the_start(seed: int, density: float) -> None:
    scenario = crossing(seed, 40, density)
    required = scenario.required()
    for a, b in combinations(uavs_of(scenario), 2):
        horizontal = math.dist(a.position_ned_m[:2], b.position_ned_m[:2])
        vertical = abs(a.position_ned_m[2] - b.position_ned_m[2])
        assert horizontal >= required.horizontal_m or vertical >= required.vertical_m


@pytest.mark.parametrize("seed", range(5))
def test_crossing_traffic_fills_the_box_of_its_density_and_goes_right_across(seed: int) -> None:
    uavs = uavs_of(crossing(seed, 100, 0.25))
    side = 20_000.0
    assert [u.id for u in uavs] == list(range(1, 101))
    for uav in uavs:
        north, east, down = uav.position_ned_m
        assert max(abs(north), abs(east)) <= side / 2
        assert -400.0 <= down <= -200.0
        (goal,) = uav.waypoints_ned_m
        assert math.dist(goal[:2], (north, east)) == pytest.approx(side)
        assert goal[2] == down
        course = math.degrees(math.atan2(goal[1] - east, goal[0] - north))
        assert math.remainder(course - uav.heading_deg, 360.0) == pytest.approx(0.0, abs=1e-6)
    norths = [u.position_ned_m[0] for u in uavs]
    assert min(norths) < -side / 4
    assert max(norths) > side / 4


def test_a_box_too_small_for_its_zones_is_refused() -> None:
    with pytest.raises(TooDenseError, match="density_per_km2"):
        uavs_of(crossing(count=100, density=100.0))


@pytest.mark.parametrize("count", [1, 2, 6, 11])
def test_converging_traffic_stands_evenly_on_the_circle_in_id_order(count: int) -> None:
    uavs = uavs_of(converging(count))
    bearings = [math.atan2(u.position_ned_m[1], u.position_ned_m[0]) for u in uavs]
    assert [u.id for u in uavs] == list(range(1, count + 1))
    assert bearings[0] == pytest.approx(-math.pi / 2)
    for k, (uav, bearing) in enumerate(zip(uavs, bearings, strict=True)):
        assert math.hypot(*uav.position_ned_m[:2]) == pytest.approx(2000.0)
        off = math.remainder(bearing - bearings[0] - math.tau * k / count, math.tau)
        assert off == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("count", [2, 6, 11])
def test_converging_traffic_flies_through_the_centre_to_the_opposite_point(count: int) -> None:
    for uav in uavs_of(converging(count)):
        north, east, down = uav.position_ned_m
        heading = math.radians(uav.heading_deg)
        inward = (-2000.0 * math.cos(heading), -2000.0 * math.sin(heading))
        assert inward == pytest.approx((north, east), abs=1e-5)
        goal, beyond = uav.waypoints_ned_m
        assert goal == pytest.approx((-north, -east, down), abs=1e-5)
        assert beyond == pytest.approx((-2.0 * north, -2.0 * east, down), abs=1e-5)


def test_a_scenario_that_lists_its_uavs_keeps_them_in_id_order() -> None:
    listed = tuple(Uav(k, (1000.0 * k, 0.0, -300.0), 0.0, ((0.0, 0.0, -300.0),)) for k in (3, 1, 2))
    assert [u.id for u in uavs_of(Scenario("listed", 60.0, uav=listed))] == [1, 2, 3]
