"""`four_way` begun when all are in conflict already: fault plans are tried on it."""

from __future__ import annotations

import msgspec

from fleet.config.loading import read_scenario, with_faults
from fleet.config.scenario import Scenario
from fleet.faults.rules import Rule
from fleet.faults.shorthand import rules_of
from fleet.protocol.messages import Election
from tests.conftest import KeepingRecorder, kept_run

FAR_M = 1200
NEAR = tuple(
    f"uav.{uav}.position_ned_m=[{north}, {east}, -300]"
    for uav, (north, east) in enumerate([(0, -FAR_M), (0, FAR_M), (FAR_M, 0), (-FAR_M, 0)], start=1)
)
"""`four_way` begun when all are in conflict already; they lose separation after 32 s."""
UAVS = (1, 2, 3, 4)

Texts = dict[str, list[str]]


def near(duration_s: float, faults: Texts | None = None, *more: str) -> Scenario:
    """The scenario as the command line makes it."""
    loaded = read_scenario("four_way", (*NEAR, f"duration_s={duration_s}", *more)).scenario
    return with_faults(loaded, rules_of(faults or {}, 0.2), "four_way")


def with_plan(scenario: Scenario, *plan: Rule) -> Scenario:
    return msgspec.structs.replace(scenario, fault=plan)


def run(scenario: Scenario) -> KeepingRecorder:
    """In memory, with all that was said."""
    return kept_run(scenario)


def arguments(duration_s: float, faults: Texts) -> list[str]:
    """The same for the command line."""
    out = ["run", "four_way", "--duration", str(duration_s), "--json"]
    for setting in NEAR:
        out += ["--set", setting]
    for name, texts in faults.items():
        for text in texts:
            out += [f"--{name}", text]
    return out


def elections(run_recorder: KeepingRecorder) -> list[Election]:
    return [m for m in run_recorder.kept if isinstance(m, Election)]
