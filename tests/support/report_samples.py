"""Runs that the tests of the report share: logs, and what they tell."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from fleet.analysis.recorded_run import RecordedRun
from fleet.config.loading import read_scenario, with_faults
from fleet.config.scenario import Scenario
from fleet.report.run_data import RunData, run_data_of
from fleet.simulation.simulation import RunOptions, run_fleet

FAULTS: list[dict[str, Any]] = [
    {"kind": "latency", "base_s": 0.5},
    {"kind": "loss", "probability": 0.3},
    {"kind": "partition", "groups": "1,2/3,4", "start_s": 50.0, "end_s": 55.0},
    {"kind": "kill", "node": "1", "start_s": 30.0},
]


@lru_cache
def log_of(name: str, *settings: str, faults: bool = False) -> Path:
    """A log of a packaged scenario, flown in memory once in each test process."""
    scenario = read_scenario(name, settings).scenario
    if faults:
        scenario = with_faults(scenario, FAULTS, name)
    return logged(scenario)


def logged(scenario: Scenario) -> Path:
    """A log of a scenario."""
    path = Path(mkdtemp(prefix="fleet-report-")) / f"{scenario.name}.mcap"
    outcome = run_fleet(RunOptions(scenario, bus="memory", out=path), lambda _: None)
    assert outcome.status == "complete"
    return path


@lru_cache
def clean() -> RunData:
    """The four-way encounter, undisturbed."""
    return run_data_of(RecordedRun.of_log(log_of("four_way", "duration_s=100")))


@lru_cache
def disturbed() -> RunData:
    """The same with delays, losses, a partition and the death of the computing UAV."""
    return run_data_of(
        RecordedRun.of_log(log_of("four_way", "duration_s=80", "seed=2", faults=True))
    )


@lru_cache
def alone() -> RunData:
    """One UAV, which nobody tells anything."""
    return run_data_of(RecordedRun.of_log(log_of("converge", "generate.count=1", "duration_s=5")))
