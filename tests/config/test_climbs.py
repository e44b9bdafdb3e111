"""A UAV's own climb: at the start, and of its guidance."""

from __future__ import annotations

import math

import pytest

from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError
from fleet.model.units import to_ns
from fleet.model.vehicle.flight import State
from fleet.simulation.flying import run


def flown(scenario: Scenario, uav: int, seconds: float) -> State:
    """Where the plan alone leads a UAV."""
    table = next(u for u in scenario.uav if u.id == uav)
    pilot, plan, state = scenario.pilot(uav, table.speed_mps), table.plan(), table.state()
    for _ in range(round(seconds / scenario.tick_s)):
        plan, states = pilot.follow(plan, state, scenario.tick_ns)
        state = states[-1]
    return state


def climbing(**more: float) -> Scenario:
    """UAV 1 of `head_on` on its way to a waypoint 3 km higher, at 25 m/s."""
    settings = {
        "uav.1.waypoints_ned_m": [[0, 30_000, -3300]],
        **{f"uav.1.{k}": more[k] for k in more},
    }
    return load_scenario("head_on", settings)


def test_a_uav_may_start_in_a_climb() -> None:
    state = climbing(climb_mps=5.0).uav[0].state()
    north, east, down = state.velocity_ned_mps
    assert down == pytest.approx(-5.0, abs=1e-12)
    assert math.hypot(north, east) == pytest.approx(math.sqrt(25.0**2 - 5.0**2), abs=1e-12)
    assert load_scenario("head_on").uav[0].state().flight_path_rad == 0.0


def test_its_guidance_may_climb_otherwise_than_that_of_the_fleet() -> None:
    """At 5 m/s from the first tick on: after 60 s it is 300 m higher, to the millimetre."""
    both = climbing(climb_mps=5.0, guidance_climb_mps=5.0)
    start = -both.uav[0].position_ned_m[2]
    assert -flown(both, 1, 60.0).down_m - start == pytest.approx(300.0, abs=1e-3)
    # Of the fleet 3 m/s: less, also from a start at 5 m/s, and from level a ramp less.
    assert -flown(climbing(climb_mps=5.0), 1, 60.0).down_m - start == pytest.approx(181.0, abs=1.0)
    assert -flown(climbing(), 1, 60.0).down_m - start == pytest.approx(178.0, abs=2.0)
    assert both.pilot(2, 25.0).settings.climb_mps == 3.0


def test_a_run_begins_in_the_climb_and_others_know_of_it() -> None:
    scenario = load_scenario(climbing(climb_mps=5.0, guidance_climb_mps=5.0), {"duration_s": 10})
    flight = run(scenario)
    truth, told = flight["1/truth"], flight["1/adsb/0"]
    assert truth.velocity_ned_mps[0, 2] == pytest.approx(-5.0)
    assert told.guidance_climb_mps[0] == pytest.approx(5.0)
    up = truth.position_ned_m[0, 2] - truth.position_ned_m[:, 2]
    assert up[-1] == pytest.approx(5.0 * to_ns(10) / 1e9, abs=1e-3)


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"uav.1.climb_mps": 7}, "uav.1.climb_mps: 7 m/s is more than uav.1 can fly at 25 m/s"),
        ({"uav.1.climb_mps": -7}, "uav.1.climb_mps: 7 m/s is more"),
        ({"uav.1.guidance_climb_mps": 7}, "uav.1.guidance_climb_mps: 7 m/s .* at most 6.47"),
        (
            {"uav.1.guidance_climb_mps": 6, "guidance.level_off_s": 1.2},
            "level_off_s: too short for uav.1 to level off from uav.1.guidance_climb_mps",
        ),
        ({"guidance.climb_mps": 7}, "guidance.climb_mps: 7 m/s is more than uav.1"),
        ({"uav.1.climb_mps": 700}, "uav.1.climb_mps"),
    ],
)
def test_what_cannot_be_flown_is_refused(settings: dict[str, float], why: str) -> None:
    with pytest.raises(ScenarioError, match=why):
        load_scenario("head_on", settings)


def test_what_the_fleet_cannot_climb_a_uav_may_do_without() -> None:
    """The rate of the fleet is not asked of a UAV that has its own."""
    settings = {"guidance.climb_mps": 6, "guidance.level_off_s": 3, "resolution.max_climb_mps": 3}
    settings |= {"resolution.max_dive_mps": 3, "uav.1.speed_mps": 15}
    with pytest.raises(ScenarioError, match=r"guidance.climb_mps: 6 m/s is more than uav.1"):
        load_scenario("head_on", settings)
    assert load_scenario("head_on", settings | {"uav.1.guidance_climb_mps": 2})
