"""What was flown, as the metadata of a log tell it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from fleet.log.recorder import LogError
from fleet.model.scenario import Scenario


def scenario_flown(path: Path, run: Mapping[str, str]) -> Scenario:
    """The scenario in the metadata record `run` of a log, with every key as it was flown.

    Raises:
        LogError: it is not there, or not understood.

    """
    if "effective_scenario" not in run:
        raise LogError(f"{path} holds no fleet run: its scenario is missing")
    try:
        return msgspec.json.decode(run["effective_scenario"], type=Scenario)
    except ValueError as error:
        raise not_understood(path, run, error) from error


def not_understood(path: Path, run: Mapping[str, str], error: ValueError) -> LogError:
    """What to raise where the scenario or the fault plan of a log cannot be read."""
    version = run.get("fleet_version", "unknown")
    return LogError(
        f"{path}: its scenario is not understood ({error}); use the version of fleet that wrote "
        f"it, {version}"
    )
