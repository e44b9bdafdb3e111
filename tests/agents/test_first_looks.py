"""Looked at all together, members are found as free as one by one."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest

from benchmarks.resolution import alerted, converging, obeyed
from fleet.agents import first_looks
from fleet.agents.advisory import Advisory, Situation
from fleet.agents.geometric import GeometricResolver
from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.model.conflict.tracks import ActiveManoeuvre
from fleet.model.words import Manoeuvre

CHANGES = {
    "": [],
    "growing": ["resolution.growth_mps=2", "resolution.vertical_growth_mps=0.3"],
    "climbs_shorter": ["resolution.climb_horizon_s=15"],
    "climbs_longer": ["resolution.climb_horizon_s=60"],
}


def shuffled(situation: Situation, rng: random.Random) -> Situation:
    """The same UAVs, some with a manoeuvre of any kind, and with reports of any age."""
    kinds = [
        None,
        ActiveManoeuvre(Manoeuvre.TURN, rng.uniform(-math.pi, math.pi), 0.0),
        ActiveManoeuvre(Manoeuvre.CLIMB, 0.0, 3.0, -400.0),
        ActiveManoeuvre(Manoeuvre.TURN_CLIMB, rng.uniform(-math.pi, math.pi), -3.0, -200.0),
    ]
    aircraft = tuple(
        replace(craft, manoeuvre=rng.choice(kinds), age_s=rng.uniform(0.0, 3.0))
        for craft in situation.aircraft
    )
    gone = frozenset(rng.sample(situation.members, rng.randint(0, 1)))
    return replace(situation, aircraft=aircraft, unreachable=gone)


def advised(of: Scenario, situation: Situation) -> list[Advisory]:
    return list(GeometricResolver(of).resolve(situation))


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES.keys())
def test_a_round_is_the_same_without(changes: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    of = read_scenario("converge", ["generate.count=5", *changes]).scenario
    situation, told = alerted(of)
    rng = random.Random(1)
    asked = [situation, obeyed(situation, told), *(shuffled(situation, rng) for _ in range(4))]
    together = [repr(advised(of, s)) for s in asked]
    monkeypatch.setattr(first_looks, "FEW_PAIRS", -1)
    assert [repr(advised(of, s)) for s in asked] == together


def test_what_is_kept_is_told_how_free_it_is_when_it_is_reviewed() -> None:
    of = converging(4)
    situation = obeyed(*alerted(of))
    reviewed = replace(
        situation, aircraft=tuple(replace(a, review=True) for a in situation.aircraft)
    )
    kept = [a for a in advised(of, situation) if a.manoeuvre == Manoeuvre.KEEP]
    assert kept
    assert not any(a.unresolved for a in kept)
    known = [a for a in advised(of, reviewed) if a.manoeuvre == Manoeuvre.KEEP]
    assert all(1.0 <= a.least_separation < 10.0 for a in known)
