"""A rule may have a seed of its own: then its draws are not those of the scenario's seed."""

from __future__ import annotations

from typing import Any

from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder


def digest(scenario: Scenario) -> str:
    run_recorder = RunRecorder(scenario, None)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return run_recorder.digest


def lossy(of_scenario: int, **own: Any) -> Scenario:
    rule = {"kind": "loss", "probability": 0.5, **own}
    return load_scenario("head_on", {"duration_s": 5, "seed": of_scenario, "fault": [rule]})


def test_a_rule_with_the_seed_of_the_scenario_changes_nothing() -> None:
    assert digest(lossy(4, seed=4)) == digest(lossy(4))


def test_a_rule_with_another_seed_draws_as_in_a_scenario_of_that_seed() -> None:
    assert digest(lossy(4, seed=9)) == digest(lossy(9)) != digest(lossy(4))


def test_a_seed_goes_to_the_noise_of_sensors_too() -> None:
    rule = {"kind": "navigation", "node": "*", "noise_m": 20.0}
    table = {"duration_s": 5, "seed": 4}
    one = load_scenario("head_on", {**table, "fault": [rule]})
    two = load_scenario("head_on", {**table, "fault": [{**rule, "seed": 9}]})
    assert digest(one) != digest(two)
