"""Real runs are valid, and invalid in the right place as soon as one thing is wrong."""

from __future__ import annotations

import pytest

from fleet.analysis.invariants import History, Records, Verdict, Verdicts, check
from fleet.model.scenario import Scenario
from fleet.run.ledger import Ledger
from fleet.run.memory import run_in_memory
from tests.mutants import MUTANTS


def judged(scenario: Scenario) -> Verdicts:
    """Run a scenario in memory and check it."""
    records = Records()
    ledger = Ledger(scenario, records)
    for _ in run_in_memory(scenario, ledger):
        pass
    return check(History(scenario, scenario.fault, records.kept, digest=ledger.digest))


@pytest.mark.parametrize("name", MUTANTS)
def test_a_mutant_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mutant = MUTANTS[name]
    mutant.patch(monkeypatch)
    verdicts = judged(mutant.scenario)
    assert mutant.breaks in verdicts.broken
    assert verdicts.overall is Verdict.INVALID
    assert verdicts.of(mutant.breaks).witnesses


@pytest.mark.parametrize("name", MUTANTS)
def test_the_real_system_is_valid_in_the_same_scenario(name: str) -> None:
    verdicts = judged(MUTANTS[name].scenario)
    assert verdicts.broken == ()
    assert verdicts.overall is Verdict.VALID
