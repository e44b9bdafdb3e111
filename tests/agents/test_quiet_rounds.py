"""Rounds in which nobody is told anything new are told from others, and change nothing."""

from __future__ import annotations

import pytest

from fleet.agents import quiet_rounds
from fleet.agents.advisory import Advisory, Situation
from fleet.agents.quiet_rounds import QuietRounds
from fleet.config.loading import convert, load_scenario
from fleet.config.scenario import Scenario
from fleet.fuzz.cases import case_of
from tests.support.digests import digest

FAULTS = {"latency": "500ms", "loss": "30%"}


def flown(name: str, duration_s: float) -> Scenario:
    return load_scenario(name, {"duration_s": duration_s}, FAULTS)


CASES = {
    "head_on": (flown("head_on", 90.0), 0.85),
    "side": (flown("side", 90.0), 0.85),
    "four_way": (flown("four_way", 110.0), 0.7),
    "unreachable": (convert(case_of(57), "case 57"), 0.0),
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_is_the_same_without(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    of, share = CASES[case]
    rounds: list[bool] = []
    plainly = QuietRounds.advisories

    def seen(quiet: QuietRounds, situation: Situation) -> list[Advisory] | None:
        told = plainly(quiet, situation)
        rounds.append(told is not None)
        return told

    monkeypatch.setattr(QuietRounds, "advisories", seen)
    together = digest(of)
    assert sum(rounds) > share * len(rounds)
    monkeypatch.setattr(QuietRounds, "advisories", lambda *_: None)
    assert digest(of) == together


def test_a_plan_is_not_taken_to_be_blocked_for_longer_than_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Or manoeuvres would not end: what the comparison above is there to find."""
    of, _ = CASES["head_on"]
    rightly = digest(of)
    monkeypatch.setattr(quiet_rounds, "is_deep", lambda *_: True)
    assert digest(of) != rightly
