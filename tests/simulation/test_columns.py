"""Tracks as columns, for all receivers at once: a run comes to the same as with one after another.

Every message of a run, and so its digest, follows from what everybody believes of everybody.
"""

from __future__ import annotations

import pytest

from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.loss import Loss
from fleet.faults.rules import Rule
from fleet.node import base
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder

NAVIGATION = '{kind="navigation", node="2", start_s=4, end_s=9, bias_ned_m=[400, 0, 0]}'
CASES = {
    "clean": ["generate.count=14", "generate.density_per_km2=1"],
    "processes": [
        "generate.count=8",
        'fault=[{kind="pause", node="3", start_s=2, end_s=5}, '
        '{kind="kill", node="4", start_s=3, end_s=7}, {kind="kill", node="5", start_s=6}, '
        '{kind="kill", node="coordinator", start_s=5}]',
    ],
    "late and lost": [
        "generate.count=10",
        "generate.density_per_km2=1",
        'fault=[{kind="latency", base_s=0.2, jitter_s=0.5, distribution="exponential"}, '
        '{kind="burst", loss=0.2, mean_ticks=3}, {kind="loss", probability=0.2, src="2-5"}, '
        '{kind="reorder", probability=0.1, delay_s=0.7, class="adsb", start_s=3}]',
    ],
    "far and parted": [
        "generate.count=10",
        "generate.density_per_km2=1",
        'fault=[{kind="range", model="rayleigh", scale_m=2500}, '
        '{kind="partition", groups="1-4/5-9,coordinator", start_s=4, end_s=9}, '
        '{kind="latency", base_s=0.1, jitter_s=0.3, distribution="lognormal", dst="uav"}]',
    ],
    "copied": [
        "generate.count=8",
        'fault=[{kind="duplicate", probability=0.3, delay_s=0.2}, {kind="loss", probability=0.2}]',
    ],
    "radio range": [
        "generate.count=14",
        "generate.density_per_km2=1",
        "surveillance.range_m=1500",
        'fault=[{kind="pause", node="3", start_s=2, end_s=5}]',
    ],
    "jumps and clocks": [
        "generate.count=8",
        f'fault=[{NAVIGATION}, {{kind="clock", node="3", start_s=2, offset_s=0.4, drift_ppm=900}}]',
    ],
}
TICKS = 130


BAD = (Loss(probability=0.4), Duplicate(probability=0.5, delay_s=0.3))


def digest(
    scenario: Scenario,
    many: int,
    patch: pytest.MonkeyPatch,
    bad_from: int = -1,
    bad: Rule = BAD[0],
) -> str:
    """Of the first ticks, with tracks as columns from so many UAVs on."""
    patch.setattr(base, "MANY", many)
    recorder = RunRecorder(scenario, None)

    def new_plan(plan: tuple[Rule, ...], tick: int) -> tuple[Rule, ...] | None:
        return (*plan, bad) if tick == bad_from else None

    for tick, _ in enumerate(run_in_memory(scenario, recorder, new_plan)):
        if tick == TICKS:
            break
    return recorder.digest


@pytest.mark.parametrize("case", CASES)
def test_a_run_is_the_same_with_columns(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = read_scenario("crossing", CASES[case]).scenario
    assert digest(scenario, 1, monkeypatch) == digest(scenario, 10**6, monkeypatch)


@pytest.mark.parametrize("bad", BAD)
def test_so_it_is_when_links_become_bad_on_the_way(
    bad: Rule, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = read_scenario("crossing", CASES["clean"]).scenario
    columns, one_by_one = (digest(scenario, m, monkeypatch, 41, bad) for m in (1, 10**6))
    assert columns == one_by_one != digest(scenario, 1, monkeypatch)
