"""The keys of the resolver: by default what the paper says, and each does something."""

from __future__ import annotations

import math

import msgspec
import pytest

from fleet.agents.sectors import sector_of
from fleet.config.scenario import Resolution, Scenario
from tests.agents.test_geometric import SCENARIO, craft, manoeuvre_advised, resolve


def ruled(**keys: float) -> Scenario:
    """SCENARIO with other keys of the resolver."""
    return msgspec.structs.replace(SCENARIO, resolution=Resolution(horizon_s=40.0, **keys))  # type: ignore[arg-type]


def test_the_defaults_are_the_papers() -> None:
    """Head-on and rear sectors of eq. 10; T_H is T_s, for which eq. 5 to 7 and 11 are written."""
    rules = SCENARIO.resolution
    assert (rules.head_on_deg, rules.rear_deg) == (30.0, 150.0)
    assert (rules.turn_cost, rules.climb_cost) == (1.0, 1.0)
    assert SCENARIO.ahead_s("climb") == SCENARIO.ahead_s("turn") == rules.horizon_s


@pytest.mark.parametrize(
    ("angle_deg", "sector"),
    [(-44.9, "head_on"), (45.0, "right"), (119.9, "right"), (120.0, "rear"), (-121.0, "rear")],
)
def test_sectors_can_be_moved(angle_deg: float, sector: str) -> None:
    assert sector_of(math.radians(angle_deg), Resolution(head_on_deg=45, rear_deg=120)) == sector


def test_who_comes_from_the_side_is_turned_if_that_counts_as_ahead() -> None:
    """The paper's side encounter has a collision angle of 45 degrees."""
    pair = craft(1, 0.0, -800.0, 90.0), craft(2, -800.0, 0.0, 0.0)
    assert resolve(*pair)[2].manoeuvre == "climb"
    told = resolve(*pair, scenario=ruled(head_on_deg=60.0))[2]
    assert (told.sector, told.manoeuvre) == ("head_on", "turn")


@pytest.mark.parametrize(
    ("met_s", "climb_horizon_s", "climbs"),
    [(60.0, 0.0, False), (60.0, 20.0, True), (110.0, 0.0, True), (110.0, 60.0, False)],
)
def test_climbs_are_free_for_twice_their_own_horizon(
    met_s: float, climb_horizon_s: float, climbs: bool
) -> None:
    """Above and below UAV 1 others come towards UAV 2, later than twice T_H or sooner."""
    north_m = -800.0 + 50.0 * met_s
    heights_m = [side * (53.0 + 99.0 * k) for side in (-1.0, 1.0) for k in range(7)]
    oncoming = [
        craft(n, north_m, 0.0, 180.0, down_m=-300.0 - height_m)
        for n, height_m in enumerate(heights_m, 3)
    ]
    pair = craft(1, 0.0, -800.0, 90.0), craft(2, -800.0, 0.0, 0.0)
    told = resolve(*pair, *oncoming, scenario=ruled(climb_horizon_s=climb_horizon_s))[2]
    assert (told.manoeuvre, told.stage) == (("climb", "axis") if climbs else ("turn", "other"))


def test_the_horizon_of_climbs_is_not_that_of_turns() -> None:
    """UAV 2 turns out of UAV 1's way, whatever T_H is: UAV 3 is met 60 s later, within 2 T_s."""
    crafts = (
        craft(1, 0.0, -900.0, 90.0),
        craft(2, 0.0, 900.0, -90.0),
        craft(3, -1500.0, -700.0, 0.0),
    )
    found = [resolve(*crafts, scenario=ruled(climb_horizon_s=t))[2] for t in (0.0, 5.0, 100.0)]
    assert found[0].manoeuvre == "turn"
    assert {f.turn_rad for f in found} == {found[0].turn_rad}


def test_a_manoeuvre_is_kept_for_as_long_as_its_own_horizon_is_free() -> None:
    """A climb that meets somebody in 30 s is changed, if T_H is not shorter than that."""
    own = craft(1, 0.0, -900.0, 90.0)
    climbing = resolve(own, craft(2, -900.0, 0.0, 0.0))[2]
    assert climbing.manoeuvre == "climb"
    flown = craft(2, -900.0, 0.0, 0.0, manoeuvre=manoeuvre_advised(climbing))
    other = craft(3, 900.0, 0.0, 180.0, down_m=climbing.level_down_m)
    assert resolve(own, flown, other, scenario=ruled(climb_horizon_s=20.0))[2].manoeuvre == "keep"
    assert resolve(own, flown, other)[2].manoeuvre != "keep"


def test_costs_decide_how_much_to_turn_and_how_much_to_climb() -> None:
    """UAV 3 must do both at once: what is dear it does less."""
    crafts = (
        craft(1, 0.0, -800.0, 90.0),
        craft(2, 294.0, -840.6, 100.8),
        craft(3, 788.8, -1062.1, 132.7),
    )
    turning = resolve(*crafts, scenario=ruled(turn_cost=0.05, turn_candidates=5))[3]
    climbing = resolve(*crafts, scenario=ruled(climb_cost=0.05, turn_candidates=5))[3]
    assert (turning.stage, climbing.stage) == ("both", "both")
    assert abs(turning.turn_rad) > abs(climbing.turn_rad)
    assert abs(turning.climb_mps) < abs(climbing.climb_mps)
