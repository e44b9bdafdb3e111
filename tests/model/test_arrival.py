"""Arrival and what follows it: conflicts near the last waypoint, and aircraft left alone there."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from fleet.config.scenario import Scenario, Uav
from fleet.model.units import wrap_angle
from tests.conftest import KeepingRecorder, kept_run, truths

NORTH = Uav(1, (-1500.0, 0.0, -300.0), 0.0, ((0.0, 0.0, -300.0),))
SOUTH = Uav(2, (1500.0, 0.0, -300.0), 180.0, ((-400.0, 0.0, -300.0),))


def fly(*uavs: Uav, **changes: Any) -> KeepingRecorder:
    scenario = msgspec.convert(
        {"name": "arrival", "duration_s": 160.0, "uav": uavs, **changes},
        Scenario,
        from_attributes=True,
    )
    return kept_run(scenario)


@pytest.mark.parametrize("last_m", [400.0, 0.0, -400.0])
def test_after_a_conflict_near_its_last_waypoint_a_uav_returns_to_its_last_leg(
    last_m: float,
) -> None:
    """UAV 2 meets UAV 1 at the origin; its last waypoint is there, or 400 m before or behind."""
    goal = (last_m, 0.0, -300.0)
    run = fly(NORTH, msgspec.structs.replace(SOUTH, waypoints_ned_m=(goal,)))
    assert run.separation.least() >= 1.0
    assert {m.mode for m in truths(run, 2)} == {"plan", "turn", "arrived"}
    for uav, course in ((1, 0.0), (2, math.pi)):
        end = truths(run, uav)[-1]
        assert end.mode == "arrived"
        assert wrap_angle(end.heading_rad - course) == pytest.approx(0.0, abs=0.01)
        assert end.position_ned_m[1] == pytest.approx(0.0, abs=10.0)


@pytest.mark.parametrize("kind", ["kill", "pause"])
def test_a_waypoint_passed_without_a_process_is_not_flown_back_to(kind: str) -> None:
    """Stopped or dead from 10 s to 60 s, it passes its first waypoint at 40 s."""
    waypoints = ((-500.0, 0.0, -300.0), (2000.0, 0.0, -300.0))
    fault = {"kind": kind, "node": "1", "start_s": 10.0, "end_s": 60.0}
    uav = msgspec.structs.replace(NORTH, waypoints_ned_m=waypoints)
    found = truths(fly(uav, duration_s=100.0, fault=[fault]), 1)
    assert [m.waypoint_index for m in found] == [m.t_ns // 10**9 >= 36 for m in found]
    assert all(m.heading_rad == pytest.approx(0.0, abs=1e-6) for m in found)


def test_a_uav_whose_process_is_started_again_after_arrival_flies_the_same_line() -> None:
    """Its last leg is the diagonal, left at an angle; dead from 70 s to 80 s."""
    waypoints = ((0.0, 0.0, -300.0), (300.0, 300.0, -300.0))
    uav = msgspec.structs.replace(NORTH, waypoints_ned_m=waypoints)
    fault = {"kind": "kill", "node": "1", "start_s": 70.0, "end_s": 80.0}
    killed = truths(fly(uav, fault=[fault]), 1)
    assert {"arrived", "unmanned"} <= {m.mode for m in killed}
    end = killed[-1]
    assert end.heading_rad == pytest.approx(math.pi / 4, abs=1e-3)
    assert end.position_ned_m[0] == pytest.approx(end.position_ned_m[1], abs=1.0)
