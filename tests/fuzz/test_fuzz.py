"""Random cases: what they are, how failing ones are named, shrunk and kept."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from fleet.agents.agent import Agent
from fleet.cli.fuzz import fuzz
from fleet.config.loading import convert
from fleet.faults.registry import kinds
from fleet.fuzz.cases import case_of
from fleet.fuzz.shrink import shrink
from fleet.fuzz.trial import Trial, fly_case
from fleet.model.conflict.tracks import StateReport
from tests.conftest import Cli

FOUND = sorted((Path(__file__).parent / "found").glob("*.toml"))
"""Cases that once broke an invariant, shrunk."""


def test_a_case_is_a_function_of_its_seed() -> None:
    assert case_of(7) == case_of(7)
    assert case_of(7) != case_of(8)


def test_every_case_is_a_possible_scenario_and_all_kinds_of_faults_come() -> None:
    drawn = Counter[str]()
    for seed in range(400):
        table = case_of(seed)
        convert(table, "case")
        drawn.update(rule["kind"] for rule in table["fault"])
    assert set(drawn) == set(kinds())
    assert min(drawn.values()) > 20


@pytest.mark.parametrize("seed", range(6))
def test_cases_keep_the_invariants(seed: int) -> None:
    trial = fly_case(case_of(seed))
    assert trial.failures == ()
    assert trial.verdicts["terms rise"] == "valid"


@pytest.mark.parametrize("path", FOUND, ids=lambda p: p.stem)
def test_what_was_found_stays_mended(path: Path) -> None:
    trial = fly_case(tomllib.loads(path.read_text(encoding="utf-8")))
    assert trial.failures == ()
    assert Counter(trial.verdicts.values())["valid"] > 10


def test_the_silent_mandate_would_be_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A dead UAV's last word that its mandate is valid must not keep others from taking over."""
    straight = StateReport.straight

    def still_valid(self: StateReport) -> StateReport:
        return msgspec.structs.replace(straight(self), mandate_valid=self.mandate_valid)

    monkeypatch.setattr(StateReport, "straight", still_valid)
    table = tomllib.loads((FOUND[0].parent / "silent_mandate.toml").read_text(encoding="utf-8"))
    assert fly_case(table).failures == ("a leader again",)


@pytest.mark.parametrize("method", ["step", "__init__"])
def test_a_crash_is_a_failure_with_its_reason(monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    def fails(*_: Any) -> None:
        raise RuntimeError("no more fuel")

    monkeypatch.setattr(Agent, method, fails)
    trial = fly_case(case_of(1))
    assert trial.failures == ("crash",)
    assert "no more fuel" in trial.crash


def test_a_hang_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    def hangs(*_: Any) -> None:
        while True:
            pass

    monkeypatch.setattr(Agent, "step", hangs)
    assert fly_case(case_of(1), hang_s=0.2).failures == ("hang",)


def test_shrinking_keeps_what_is_needed_to_fail() -> None:
    table = {**case_of(3), "fault": [{"kind": "loss", "probability": n / 10} for n in range(6)]}

    def fails(candidate: dict[str, Any]) -> bool:
        return any(rule.get("probability") == 0.3 for rule in candidate["fault"])

    small = shrink(table, fails)
    assert [rule.get("probability") for rule in small["fault"]] == [0.3]
    assert len(small["uav"]) == 2
    assert small["duration_s"] < table["duration_s"]
    assert fails(small)


def test_shrinking_ends_with_its_budget() -> None:
    tried = []

    def fails(candidate: dict[str, Any]) -> bool:
        tried.append(candidate)
        return True

    shrink(case_of(3), fails, budget=5)
    assert len(tried) == 5


def test_a_campaign_counts_its_cases(cli: Cli) -> None:
    done = cli.run("fuzz", "--runs", "3", "--seed", "20", "--jobs", "2", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == 0
    assert told["runs"] == 3
    assert told["failed"] == []
    assert sum(told["invariants"]["terms rise"].values()) == 3


def test_an_interrupted_campaign_tells_what_it_has_and_how_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(first: int, _runs: int, _jobs: int) -> Iterator[Trial]:
        yield Trial(first, {}, crash="it broke")
        yield Trial(first + 1, {"terms rise": "valid"})
        raise KeyboardInterrupt

    monkeypatch.setattr("fleet.cli.fuzz.campaign", interrupted)
    assert fuzz(runs=50, seed=20, as_json=True) == 130
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert told["runs"] == 2
    assert [failed["seed"] for failed in told["failed"]] == [20]
    assert "--seed 22 --runs 48" in err
