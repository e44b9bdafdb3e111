"""Real runs are valid, and invalid in the right place as soon as one thing is wrong."""

from __future__ import annotations

import pytest

from fleet.analysis.invariants import RecordedRun, Verdict, Verdicts, check
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.scenario import Scenario
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from tests.support.mutants import MUTANTS


def judged(scenario: Scenario) -> Verdicts:
    """Run a scenario in memory and check it."""
    records = RecordCollector()
    run_recorder = RunRecorder(scenario, records)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return check(RecordedRun.of_records(scenario, records.kept, digest=run_recorder.digest))


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
