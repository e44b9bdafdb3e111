"""Packaged scenarios (TOML beside this file), and how a scenario is loaded and checked.

Whatever is wrong with a scenario becomes one `ScenarioError`: file, key and remedy in one line.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from os import PathLike
from pathlib import Path
from types import NoneType
from typing import Any

import msgspec

from fleet.arguments import require, require_each
from fleet.config.checks import problem_with
from fleet.config.explaining import explained, nearest
from fleet.config.scenario import Scenario
from fleet.config.text_files import file_text
from fleet.errors import ScenarioError
from fleet.faults.options import by_option
from fleet.faults.shorthand import rules_of, shorthands
from fleet.model.vehicle.registry import DEFAULT_MODEL

MAX_BYTES = 4 << 20


@dataclass(frozen=True)
class Loaded:
    """A scenario, the text it came from and the settings laid over it."""

    scenario: Scenario
    text: str
    overrides: tuple[str, ...]


def packaged() -> list[str]:
    """Names of the packaged scenarios."""
    folder = resources.files("fleet.config") / "scenarios"
    return sorted(
        f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")
    )


def load_scenario(
    source: str | PathLike[str] | Mapping[str, Any] | Scenario,
    settings: Mapping[str, Any] | None = None,
    faults: Mapping[str, str | Sequence[str]] | None = None,
) -> Scenario:
    """A scenario: a packaged one by name, a TOML file by path, a table as of TOML, or a Scenario.

    `settings` are laid over it by dotted key, as `{"resolution.horizon_s": 30, "uav.2.speed_mps":
    20}`; `faults` come after its own, by the names and in the forms of the command line's options,
    as `{"loss": "30%", "kill": ["1@30s", "2@40s"]}`. SI units, positions north, east, down.

    Raises:
        ScenarioError: it is not found, not readable, not TOML, or not a possible scenario.
        ArgumentError: it, the settings or the faults are nothing of the kind.

    """
    _check_given(source, settings, faults)
    if isinstance(source, Scenario):
        table, said = as_table(source), source.name
    elif isinstance(source, Mapping):
        table, said = _as_toml(source), str(source.get("name", "scenario"))
    else:
        said = str(source)
        table = _table_of(_text_of(said), said)
    for name, value in (settings or {}).items():
        _set(table, name, value, f"setting '{name}'")
    scenario = convert(table, said)
    given = {n: [text] if isinstance(text, str) else text for n, text in (faults or {}).items()}
    strange = sorted(given.keys() - {*shorthands()})
    if strange:
        raise ScenarioError(f"faults: no '{strange[0]}'; there are {', '.join(shorthands())}")
    try:
        rules = rules_of(given, scenario.surveillance.broadcast_s)
        return with_faults(scenario, rules, said)
    except ValueError as error:
        raise ScenarioError(f"faults: {str(error).removeprefix('--')}") from error


def _check_given(source: object, settings: object, faults: object) -> None:
    """Raises ArgumentError for what cannot be a scenario, settings or faults."""
    needed = "a name, a TOML file, a table or a Scenario"
    require(source, (str, PathLike, Mapping, Scenario), "scenario", needed)
    for given, what in (
        (settings, 'a dict, as {"resolution.horizon_s": 30}'),
        (faults, 'a dict of text or lists of text, as {"loss": "30%"}'),
    ):
        where = "settings" if given is settings else "faults"
        require(given, (Mapping, NoneType), where, what)
        assert given is None or isinstance(given, Mapping)
        require_each(given or (), str, where, what)
        for texts in (given or {}).values() if where == "faults" else ():
            require_each([texts] if isinstance(texts, str) else texts, str, where, what)


def read_scenario(source: str, overrides: Sequence[str] = ()) -> Loaded:
    """Load a packaged scenario by name, or a TOML file by path, with `key=value` settings over it.

    Raises:
        ScenarioError: it is not found, not readable, not TOML, or not a possible scenario.

    """
    text = _text_of(source)
    table = _table_of(text, source)
    for override in overrides:
        _lay_over(table, override)
    return Loaded(convert(table, source), text, tuple(overrides))


def checked(scenario: Scenario) -> Scenario:
    """A scenario that was built in code; raises ScenarioError as `load_scenario`."""
    return convert(as_table(scenario), scenario.name)


def with_settings(scenario: Scenario, overrides: Sequence[str], source: str) -> Scenario:
    """The scenario with `key=value` settings laid over it; raises ScenarioError as `load`."""
    if not overrides:
        return scenario
    table = as_table(scenario)
    for override in overrides:
        _lay_over(table, override)
    return convert(table, source)


def as_table(scenario: Scenario) -> dict[str, Any]:
    """The scenario as a TOML file has it: what loads again as the same one."""
    table: dict[str, Any] = _as_toml(msgspec.to_builtins(scenario))
    return table


def _as_toml(value: Any) -> Any:
    """The same as TOML has it: lists, and no keys for nothing."""
    if isinstance(value, Mapping):
        return {k: _as_toml(v) for k, v in value.items() if v is not None}
    return [_as_toml(v) for v in value] if isinstance(value, list | tuple) else value


def with_faults(scenario: Scenario, faults: Sequence[dict[str, Any]], source: str) -> Scenario:
    """The scenario with further [[fault]] tables after its own.

    Raises:
        ScenarioError: as `load`; what is wrong with a rule of an option is named by that.

    """
    if not faults:
        return scenario
    table = msgspec.to_builtins(scenario)
    table["fault"] = [*table["fault"], *faults]
    try:
        return _scenario_of(table)
    except ScenarioError as error:
        problem = str(error)
        named = by_option(problem, len(scenario.fault), faults)
        raise ScenarioError(f"{source}: {problem}" if named == problem else named) from error


def convert(table: dict[str, Any], source: str) -> Scenario:
    """The scenario of a TOML table; raises ScenarioError as `load` does."""
    try:
        return _scenario_of(table)
    except ScenarioError as error:
        raise ScenarioError(f"{source}: {error}") from error


def _scenario_of(table: dict[str, Any]) -> Scenario:
    """The scenario of a TOML table; raises ScenarioError, with key, problem and remedy."""
    table = _with_zones(_with_vehicles(table))
    try:
        scenario = msgspec.convert(table, Scenario)
    except msgspec.ValidationError as error:
        raise ScenarioError(explained(str(error), table)) from error
    problem = problem_with(scenario)
    if problem:
        raise ScenarioError(problem)
    return scenario


def _with_vehicles(table: dict[str, Any]) -> dict[str, Any]:
    """The table with each vehicle's model named, and what its UAV does not say as the fleet has it.

    Of another model than the fleet's a UAV has all that it does not say by default.
    """
    out, uavs = dict(table), table.get("uav")
    fleet = out.get("performance", {})
    if isinstance(fleet, dict):
        fleet = out["performance"] = {"vehicle": DEFAULT_MODEL, **fleet}
        if isinstance(uavs, list):
            out["uav"] = [_with_vehicle(u, fleet) for u in uavs]
    return out


def _with_zones(table: dict[str, Any]) -> dict[str, Any]:
    """The table with what zones of UAVs do not say as the fleet has it."""
    fleet, uavs = table.get("zone", {}), table.get("uav")
    if not (isinstance(fleet, dict) and isinstance(uavs, list)):
        return table
    return {**table, "uav": [_with_zone(u, fleet) for u in uavs]}


def _with_zone(uav: Any, fleet: dict[str, Any]) -> Any:
    own = uav.get("zone") if isinstance(uav, dict) else None
    return {**uav, "zone": {**fleet, **own}} if isinstance(own, dict) else uav


def _with_vehicle(uav: Any, fleet: dict[str, Any]) -> Any:
    own = uav.get("performance") if isinstance(uav, dict) else None
    if not isinstance(own, dict):
        return uav
    as_fleet = own.get("vehicle", fleet["vehicle"]) == fleet["vehicle"]
    return {**uav, "performance": {**fleet, **own} if as_fleet else own}


def _table_of(text: str, source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{source}: not valid TOML: {error}") from error


def _text_of(source: str) -> str:
    if source in packaged():
        return (resources.files("fleet.config") / "scenarios" / f"{source}.toml").read_text(
            encoding="utf-8"
        )
    path = Path(source)
    try:
        return file_text(path, source, MAX_BYTES, "a scenario", "TOML file")
    except FileNotFoundError:
        names = ", ".join(packaged())
        if path.suffix == ".toml":
            raise ScenarioError(f"{source}: no such file; packaged scenarios are {names}") from None
        near = nearest(source, packaged())
        raise ScenarioError(
            f"{source}: no such scenario or file{near}; there are {names}"
        ) from None
    except OSError as error:
        raise ScenarioError(f"{source}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # as of a name with a null character
        raise ScenarioError(f"{source}: cannot be read: {error}") from error


def _lay_over(table: dict[str, Any], override: str) -> None:
    """Set one `key=value`: dotted key, TOML value (or plain text)."""
    name, equals, text = override.partition("=")
    if not equals or not all(name.strip().split(".")):
        raise ScenarioError(f"--set {override}: write key=value, as in resolution.horizon_s=30")
    _set(table, name.strip(), _value(text.strip()), f"--set {override}")


def _set(table: dict[str, Any], name: str, value: Any, said: str) -> None:
    """Set the value of a dotted key; `uav.ID.key` names a UAV."""
    path = name.split(".")
    node: Any = table
    for n, part in enumerate(path[:-1]):
        if isinstance(node, list):
            found = [u for u in node if isinstance(u, dict) and str(u.get("id")) == part]
            if not found:
                raise ScenarioError(f"{said}: there is no UAV with ID '{part}'")
            node = found[0]
        else:
            node = node.setdefault(part, {})
        if not isinstance(node, dict | list):
            raise ScenarioError(f"{said}: {'.'.join(path[: n + 1])} is not a table")
    if isinstance(node, list):
        raise ScenarioError(f"{said}: name the UAV and the key, as in uav.1.speed_mps=20")
    node[path[-1]] = value


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
