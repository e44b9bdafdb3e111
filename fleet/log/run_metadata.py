"""What the metadata of a log tell of its run, checked like a scenario before it is believed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from fleet.config.checks import problem_with
from fleet.config.scenario import Scenario
from fleet.errors import LogError
from fleet.faults import registry
from fleet.faults.rules import Rule
from fleet.model.vehicle.registry import OWN_MODELS
from fleet.model.words import ClockMode

Metadata = Mapping[str, Mapping[str, str]]
"""The metadata records of a log by name."""

_TEXT = ("run", "clock", "bus", "fleet_version", "python", "machine", "scenario_toml")
_JSON = {
    "effective_scenario": "scenario",
    "overrides": "overrides",
    "versions": "versions",
    "external": "external",
}
_RESULT = ("status", "why", "digest")


class RunMetadata(msgspec.Struct, frozen=True, kw_only=True):
    """A run: how it was started, from the record `run`, and how it ended, from `result`.

    `scenario` has every key as it was flown. `status` is empty, and `fault_plan` None, where the
    log has no end; else that is the plan with all changes that were made on the way. `lacked_room`
    counts what was dropped because too much waited, by where that was. `external`: who took part
    was started by others.
    """

    scenario: Scenario
    run: str = ""
    clock: str = ""
    bus: str = ""
    external: bool = False
    fleet_version: str = ""
    python: str = ""
    machine: str = ""
    versions: dict[str, str] = {}
    scenario_toml: str = ""
    overrides: tuple[str, ...] = ()
    status: str = ""
    why: str = ""
    digest: str | None = None
    fault_plan: tuple[registry.FaultRule, ...] | None = None
    lacked_room: dict[str, int] = {}

    @property
    def realtime(self) -> bool:
        """Whether it was flown on wall clocks."""
        return self.clock == ClockMode.REALTIME


def run_metadata_of(path: Path, metadata: Metadata) -> RunMetadata:
    """What the metadata tell.

    Raises:
        LogError: the scenario is missing, or something is not understood or impossible.

    """
    run, result = metadata.get("run", {}), metadata.get("result", {})
    if "effective_scenario" not in run:
        raise LogError(f"{path} holds no fleet run: its scenario is missing")
    table: dict[str, Any] = {name: run[name] for name in _TEXT if name in run}
    table |= {name: result[name] for name in _RESULT if name in result}
    try:
        table |= {field: _json(run, name) for name, field in _JSON.items() if name in run}
        for name in ("fault_plan", "lacked_room"):
            if name in result:
                table[name] = _json(result, name)
        about = msgspec.convert(table, RunMetadata)
    except (ValueError, RecursionError) as error:
        raise not_understood(path, run, error) from error
    check_plan(path, about, about.scenario.fault)
    if about.fault_plan:
        check_plan(path, about, about.fault_plan)
    return about


def check_plan(path: Path, about: RunMetadata, plan: tuple[Rule, ...]) -> None:
    """Raises LogError if that cannot be flown under this fault plan."""
    problem = problem_with(msgspec.structs.replace(about.scenario, fault=plan))
    if problem:
        raise LogError(f"{path}: its scenario is not possible: {problem}")


def overrides_of(run: Mapping[str, str]) -> str:
    """The settings with which a run was started, as one text; what is none of these, as it is."""
    text = run.get("overrides", "[]")
    try:
        return ", ".join(msgspec.json.decode(text, type=tuple[str, ...]))
    except (ValueError, RecursionError):
        return text


def uavs_told(run: Mapping[str, str]) -> int:
    """The number of UAVs that the record `run` tells of; 0 if it tells none."""
    try:
        return len(msgspec.json.decode(run.get("uavs", "[]"), type=list[int]))
    except (ValueError, RecursionError):
        return 0


def not_understood(path: Path, run: Mapping[str, str], error: Exception) -> LogError:
    """What to raise where the metadata or the fault plan of a log cannot be read."""
    version, own = run.get("fleet_version", "unknown"), ""
    if "Invalid value" in str(error):  # of a kind of fault, or a vehicle
        own = f", and name modules of your own in {registry.OWN_KINDS} and {OWN_MODELS}"
    return LogError(
        f"{path}: its scenario is not understood ({error}); use the version of fleet that wrote "
        f"it, {version}{own}"
    )


def _json(values: Mapping[str, str], name: str) -> Any:
    try:
        return msgspec.json.decode(values[name])
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name}: {error}") from error
