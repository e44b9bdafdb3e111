"""What UAVs can fly, as a scenario says it: of the fleet, and of a single one."""

from __future__ import annotations

from typing import Any

import pytest

from fleet.config.loading import checked, load_scenario
from fleet.errors import ScenarioError
from fleet.model.vehicle.models.point_mass import PointMassPerformance


def bank_deg(settings: dict[str, Any], uav: int) -> float:
    performance = load_scenario("head_on", settings).performance_of(uav)
    assert isinstance(performance, PointMassPerformance)
    return performance.max_bank_deg


def test_the_model_need_not_be_named() -> None:
    assert load_scenario("head_on").performance == PointMassPerformance()
    named = {"performance.vehicle": "point_mass", "performance.max_bank_deg": 20}
    assert bank_deg(named, 1) == bank_deg({"performance.max_bank_deg": 20}, 1) == 20.0


def test_a_uav_differs_in_what_it_says_itself() -> None:
    settings = {"performance.max_acceleration_mps2": 1.5, "uav.2.performance.max_bank_deg": 15}
    scenario = load_scenario("head_on", settings)
    assert scenario.uav[0].performance is None
    assert scenario.performance_of(2) == PointMassPerformance(
        max_bank_deg=15.0, max_acceleration_mps2=1.5
    )
    assert checked(scenario) == scenario


def test_everybody_asks_for_a_uav_by_its_id() -> None:
    scenario = load_scenario(
        "head_on", {"uav.2.performance": {"max_bank_deg": 15, "max_speed_share": 1.1}}
    )
    slow, usual = scenario.model(2).limits, scenario.model(1).limits
    assert slow.turn_radius_m(25.0) > 2.0 * usual.turn_radius_m(25.0)
    assert scenario.pilot(2, 25.0).limits == slow
    assert scenario.models().of(2) == scenario.model(2)
    assert scenario.models().of(7) == scenario.model(1)
    assert scenario.speeds_mps(2, 20.0) == (15.0, 22.0)
    assert scenario.speeds_mps(1, 20.0) == (15.0, 25.0)


def test_zones_are_widened_for_the_most_agile_and_jumps_believed_for_it() -> None:
    plain = load_scenario("head_on", {"resolution.speed_candidates": 5})
    agile = {"max_bank_deg": 60, "max_acceleration_mps2": 6}
    mixed = load_scenario("head_on", {"resolution.speed_candidates": 5, "uav.1.performance": agile})
    assert mixed.outlook().required.horizontal_m > plain.outlook().required.horizontal_m
    assert mixed.track_rules().max_acceleration_mps2 == 6.0


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"performance.vehicle": "balloon"}, "performance.vehicle: .*point_mass.*FLEET_VEHICLE"),
        ({"uav.2.performance.vehicle": "x"}, "uav.2.performance.vehicle: .*use one of point_mass"),
        ({"performance.max_bnk_deg": 9}, "max_bnk_deg: unknown key .did you mean 'max_bank_deg'"),
        ({"uav.1.performance.bank": 9}, "performance.bank: unknown key.*possible here: vehicle,"),
        ({"uav.1.performance.max_bank_deg": 90}, "performance.max_bank_deg: expected"),
        ({"uav.1.performance.max_flight_path_deg": 3}, "more than uav.1 can fly at 25 m/s"),
        ({"performance": 7}, "performance: expected"),
        ({"uav.1.performance": 7}, "performance: expected"),
    ],
)
def test_what_cannot_be_flown_is_said_with_its_key(settings: dict[str, Any], why: str) -> None:
    with pytest.raises(ScenarioError, match=why):
        load_scenario("head_on", settings)
