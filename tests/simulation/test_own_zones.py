"""Runs in which one UAV has a larger zone than the others: everybody keeps clear of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.analysis.separation import PairMinimum
from fleet.config.loading import convert, read_scenario
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError
from fleet.model.conflict.risk import Required
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from fleet.study.unavoided import unavoided

NMAC = Required(20.0, 5.0)


def flown(scenario: Scenario) -> RunRecorder:
    run_recorder = RunRecorder(scenario, None, digested=False)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return run_recorder


def of(name: str, *changes: str) -> Scenario:
    return read_scenario(name, list(changes)).scenario


def required_m(scenario: Scenario, minimum: PairMinimum) -> tuple[float, float]:
    zones = [scenario.zone_of(uav) for uav in minimum.pair]
    return sum(z.radius_m for z in zones), sum(z.half_height_m for z in zones)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("head_on", ["uav.2.zone.radius_m=350", "duration_s=150"]),
        ("side", ["uav.1.zone.half_height_m=60", "duration_s=150"]),
        ("four_way", ["uav.3.zone.radius_m=300", "uav.3.zone.half_height_m=40"]),
        ("head_on", ["uav.1.zone.radius_m=80", "resolution.growth_mps=5", "duration_s=150"]),
    ],
)
def test_every_pair_keeps_what_its_own_zones_require(name: str, changes: list[str]) -> None:
    scenario = of(name, *changes)
    without = unavoided(scenario, NMAC).separation
    assert without[0].lost
    kept = flown(scenario)
    for minimum in kept.separation.minima():
        level_m, upright_m = required_m(scenario, minimum)
        normalised = max(minimum.horizontal_m / level_m, minimum.vertical_m / upright_m)
        assert minimum.least_separation == pytest.approx(normalised)
        assert normalised >= 1.0
    assert not kept.arrivals.arrivals().missing


def test_a_larger_zone_makes_a_conflict_where_there_is_none() -> None:
    """Two that pass each other 500 m apart: 400 m are required, and 600 m with a larger zone."""
    apart: dict[str, Any] = {"heading_deg": 0.0, "waypoints_ned_m": [[4000, 0, -300]]}
    there = {"id": 1, "position_ned_m": [0, 0, -300], **apart}
    back = {
        "id": 2,
        "position_ned_m": [4000, 500, -300],
        "heading_deg": 180.0,
        "waypoints_ned_m": [[0, 500, -300]],
    }
    table = {"name": "passing", "duration_s": 150.0, "uav": [there, back]}
    as_planned = flown(convert(table, "a test"))
    assert not as_planned.tally.issued
    assert as_planned.separation.minima()[0].horizontal_m == pytest.approx(500.0, abs=1.0)
    table["uav"] = [there, {**back, "zone": {"radius_m": 400.0}}]
    larger = flown(convert(table, "a test"))
    assert larger.tally.issued
    nearest = larger.separation.minima()[0]
    assert np.hypot(nearest.horizontal_m, 0.0) >= 600.0 or nearest.vertical_m >= 50.0


def test_what_a_zone_does_not_say_is_as_the_fleet_has_it() -> None:
    scenario = of("head_on", "zone.half_height_m=31", "uav.2.zone.radius_m=350")
    assert scenario.zone_of(2).half_height_m == 31.0
    assert scenario.zone_of(1).radius_m == 200.0
    assert scenario.required() == Required(400.0, 62.0)
    assert scenario.required_of((1, 2)) == Required(550.0, 62.0)


def test_a_zone_that_is_none_is_refused_by_key() -> None:
    with pytest.raises(ScenarioError, match=r"uav\.2\.zone\.radius_m"):
        of("head_on", "uav.2.zone.radius_m=0")
