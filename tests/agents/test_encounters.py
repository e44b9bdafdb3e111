"""The encounters of `benchmarks.encounters`: what they claim to be, and some of them resolved."""

from __future__ import annotations

import math
from itertools import combinations

import msgspec
import pytest

from benchmarks.encounter_sets import LATE_S, SETS, scenario_of
from benchmarks.encounters import LINGER_S, MANY, Job
from benchmarks.flown import first_loss_s, fly, path_of, undisturbed
from fleet.config.scenario import Scenario


def first_of_all_s(scenario: Scenario) -> float:
    """When any pair first loses separation without avoidance."""
    paths = [path_of(u, scenario, 110.0) for u in scenario.uav]
    return min(first_loss_s(a, b, scenario.required()) for a, b in combinations(paths, 2))


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("seed", [1, 2])
def test_every_encounter_is_a_conflict_that_begins_in_time(name: str, seed: int) -> None:
    scenario = scenario_of(name, seed)
    first_s = first_of_all_s(scenario)
    assert first_s < math.inf
    assert first_s > (LATE_S[0] if name == "late" else 40.0)


def test_an_encounter_is_a_function_of_its_seed() -> None:
    assert [scenario_of(n, 2) for n in SETS] == [scenario_of(n, 2) for n in SETS]
    assert scenario_of("pairs", 2) != scenario_of("pairs", 3)


def test_undisturbed_is_what_happens_when_nobody_is_commanded() -> None:
    scenario = scenario_of("late", 5)
    none = fly(msgspec.structs.replace(scenario, resolver="none"))
    alone = undisturbed(scenario)
    assert none.commands == {}
    assert none.separation == alone
    assert none.arrivals.delays_s == [0.0, 0.0]
    last_s = max(path_of(u, scenario, 110.0).reached_s[-1] for u in scenario.uav)
    assert [row.arrival_s for row in none.arrivals.rows if row.arrival_s == last_s]
    assert 0.40 < last_s / scenario.duration_s < 0.50


@pytest.mark.parametrize(
    ("name", "seed", "links"),
    [
        ("pairs", 32, "perfect"),  # abreast of the other, and past its own waypoint
        ("pairs", 16, "faulty"),
        ("converging", 10, "perfect"),
        ("circle8", 1, "perfect"),  # one manoeuvres abreast of one that crosses
        ("takeover4", 2, "perfect"),  # overtakes one that has arrived and flies straight on
        ("late", 1, "faulty"),  # a climb
        ("late", 3, "faulty"),  # a turn
        ("late", 17, "perfect"),  # from the start
    ],
)
def test_all_keep_separation_and_arrive(name: str, seed: int, links: str) -> None:
    outcome = fly(Job(name, seed, links).scenario(), LINGER_S)
    assert outcome.separation.lost == ()
    assert [row.id for row in outcome.arrivals.rows if not row.arrived] == []
    assert max(outcome.commands.values()) <= MANY
