"""Rare events and smallest faults: probabilities that are known otherwise, and points that are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import tomli_w

from fleet.config.scenario import Scenario
from fleet.errors import StudyError
from fleet.faults.channel import Channel
from fleet.faults.draws import LinkMessage
from fleet.study import search as search_module
from fleet.study import stress as stress_module
from fleet.study.design import cells_of
from fleet.study.loading import load_study
from fleet.study.search import search
from fleet.study.statistics.subset import SubsetPlan, subset_simulation
from fleet.study.stress import stress
from fleet.study.stress_space import ENCOUNTER_COORDINATES, seed_of, stress_space
from fleet.study.study_file import Study
from tests.conftest import Cli

LOSSY: dict[str, Any] = {
    "name": "lossy",
    "faults": {"loss": "30%", "latency": "0.3s"},
    "encounters": {"kind": "pairs", "climbing": 0.0, "duration_s": 60.0, "cpa_s": [40, 45]},
}


def lost(scenario: Scenario, at_s: float) -> set[int]:
    """Which of many broadcasts about a time from UAV 1 to UAV 2 are lost."""
    channel = Channel(scenario.fault, scenario.seed, scenario.tick_ns)
    t_ns = round(at_s * 1e9)
    return {
        n for n in range(200) if not channel.fate(LinkMessage(1, 2, "adsb", n, t_ns)).deliveries
    }


def test_seeds_of_few_coordinates_in_many_come_to_the_binomial_probability() -> None:
    """All of 10 seeds are of the lower half: 2^-10. Of 100 coordinates, that are redrawn."""

    def limit(points: np.ndarray) -> np.ndarray:
        negative: np.ndarray = np.count_nonzero(points[:, -10:] < 0.0, axis=1)
        return 10.0 - negative

    found = subset_simulation(limit, 100, 3, SubsetPlan(points=400, repeats=8), redrawn=95)
    assert found.estimate.covers(2.0**-10)
    assert found.estimate.high < 4.0 * 2.0**-10


def test_a_point_is_a_scenario_and_its_first_coordinates_the_encounter() -> None:
    space = stress_space(load_study(LOSSY), cells_of(load_study(LOSSY))[0])
    point = np.random.default_rng(0).standard_normal(space.dimensions)
    one = space.scenario_at(point)
    assert space.scenario_at(point.copy()) == one
    moved = point.copy()
    moved[:ENCOUNTER_COORDINATES] += 1e-4
    near = space.scenario_at(moved)
    assert near.fault == one.fault
    assert near.uav != one.uav
    assert math.dist(near.uav[0].position_ned_m, one.uav[0].position_ned_m) < 10.0


def test_one_seed_changes_the_draws_of_its_rule_in_its_window_alone() -> None:
    space = stress_space(load_study(LOSSY), cells_of(load_study(LOSSY))[0])
    assert space.seeds == 2 + 2 * 12  # two rules in windows of 5 s
    point = np.random.default_rng(1).standard_normal(space.dimensions)
    before = space.scenario_at(point)
    changed = [n for n, rule in enumerate(before.fault) if rule.name == "loss"][3]
    point[ENCOUNTER_COORDINATES + 2 + changed] += 1e-9
    after = space.scenario_at(point)
    start_s = before.fault[changed].start_s
    assert start_s == 15.0
    assert lost(after, start_s + 1.0) != lost(before, start_s + 1.0)
    for other_s in (start_s - 1.0, start_s + 6.0):
        assert lost(after, other_s) == lost(before, other_s)
    assert 30 < len(lost(after, start_s + 1.0)) < 90


def test_seeds_of_coordinates_next_to_each_other_differ() -> None:
    assert len({seed_of(1.0 + n * 2.0**-52) for n in range(100)}) == 100


def test_the_probability_of_a_loss_without_avoidance_is_that_of_the_geometry(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Miss distances up to 8 km and 1 km in altitude: 1 in 20 times 1 in 20 are within the zone."""
    table = {
        "name": "geometry",
        "encounters": {
            "kind": "pairs",
            "climbing": 0.0,
            "miss_m": [0, 8000],
            "vertical_m": [0, 1000],
            "altitude_m": [2000, 2000],
            "apart_m": 0,
        },
    }

    def margin(scenario: Scenario, _study: Study, _event: str) -> float:
        one, two = scenario.uav
        apart = np.subtract(one.position_ned_m, two.position_ned_m)
        headings = np.radians([one.heading_deg, two.heading_deg])
        speeds = np.array([one.speed_mps, two.speed_mps])
        north, east = speeds * np.cos(headings), speeds * np.sin(headings)
        closing = np.array([north[0] - north[1], east[0] - east[1]])
        t_s = -(apart[:2] @ closing) / (closing @ closing)
        level = np.linalg.norm(apart[:2] + t_s * closing) / 400.0
        return float(max(level, abs(apart[2]) / 50.0)) - 1.0

    monkeypatch.setattr(stress_module, "margin_of", margin)
    found = stress(load_study(table), 0, plan=SubsetPlan(points=300, repeats=6))
    assert found.event.estimate.covers(0.05 * 0.05)
    assert found.event.estimate.high < 0.0075
    worst = [value for value, _ in found.examples]
    assert worst == sorted(worst)
    assert worst[0] < 0.0


def test_the_smallest_fault_is_found_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The event happens from 40 % and 2 s on, so the smallest is just there."""
    table = {
        **LOSSY,
        "faults": {},
        "design": {"kind": "latin_hypercube", "points": 2},
        "factor": [
            {"name": "loss", "fault": "loss", "unit": "%", "low": 0.0, "high": 100.0},
            {"name": "latency", "fault": "latency", "unit": "s", "low": 0.0, "high": 4.0},
        ],
    }

    def margin(scenario: Scenario, _study: Study, _event: str) -> float:
        by_name = {rule.name: rule for rule in scenario.fault}
        loss, latency = by_name["loss"], by_name["latency"]
        short = max(0.4 - getattr(loss, "probability"), 0.0)  # noqa: B009
        short += max(2.0 - getattr(latency, "base_s"), 0.0)  # noqa: B009
        return short if short > 0.0 else -0.1

    monkeypatch.setattr(search_module, "margin_of", margin)
    found = search(load_study(table), 3, generations=25)
    assert found.happens
    loss, latency = (level.number for level in found.cell.levels)
    assert loss == pytest.approx(40.0, abs=2.0)
    assert latency == pytest.approx(2.0, abs=0.1)
    assert found.size == pytest.approx(math.sqrt((0.4**2 + 0.5**2) / 2.0), abs=0.02)
    assert found.flown > 100


def test_what_cannot_be_stressed_or_searched_is_said() -> None:
    near = {"share": 0.5, "miss_m": 100, "vertical_m": 10}
    study = load_study({**LOSSY, "encounters": {"kind": "pairs", "near": near}})
    with pytest.raises(StudyError, match="near"):
        stress(study, 0)
    two = {"kind": "files", "paths": ["head_on", "four_way"]}
    with pytest.raises(StudyError, match=r"encounters\.paths: .* name the one to stress"):
        stress(load_study({**LOSSY, "encounters": two}), 0)
    with pytest.raises(StudyError, match="low and high"):
        search(load_study(LOSSY), 0)


def test_what_happens_without_any_fault_has_no_size(monkeypatch: pytest.MonkeyPatch) -> None:
    table = {
        **LOSSY,
        "faults": {},
        "design": {"kind": "latin_hypercube", "points": 2},
        "factor": [{"name": "loss", "fault": "loss", "unit": "%", "low": 0.0, "high": 100.0}],
    }
    monkeypatch.setattr(search_module, "margin_of", lambda *_: -0.1)
    found = search(load_study(table), 3, generations=2)
    assert (found.size, found.cell.text) == (0.0, "loss 0%")


def test_where_examples_cannot_go_is_said_before_anything_is_flown(cli: Cli) -> None:
    (cli.folder / "lossy.toml").write_text(tomli_w.dumps(LOSSY), encoding="utf-8")
    (cli.folder / "worst").mkdir()
    (cli.folder / "worst" / "lost-7.toml").touch()
    told = cli.run("study", "stress", "lossy.toml", "--points", "1000000", "--out", "worst")
    assert told.returncode == 2
    assert told.stderr == "fleet: worst/lost-7.toml exists already: name another --out\n"
