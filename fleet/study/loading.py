"""Study files loaded and checked; whatever is wrong with one becomes one `StudyError`."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import msgspec

from fleet.agents.resolvers import load_resolver
from fleet.arguments import require
from fleet.config.explaining import plainly
from fleet.config.loading import MAX_BYTES, load_scenario, packaged
from fleet.config.scenario import Scenario
from fleet.config.text_files import file_text
from fleet.errors import ScenarioError, StudyError
from fleet.study.design import Cell, cells_of
from fleet.study.encounters.scenario_files import ScenarioFiles
from fleet.study.scenario_of_run import scenario_of_run
from fleet.study.study_checks import problems_of
from fleet.study.study_file import Study

TRIED = 20
FORMS = {
    "name": "1 to 64 letters, digits, '-' or '_'",
    "factor.name": "1 to 40 letters, digits or '_', a letter first",
    "encounters.kind": "one of as_planned, pairs, overtaking, converging, traffic, files",
    "design.kind": "one of grid, latin_hypercube, sobol, saltelli",
    "stop.event": "lost or nmac",
}
"""What text of a study file has to look like, in words, by key."""

PLAIN: dict[str, Any] = {
    "name": "plain",
    "duration_s": 120.0,
    "uav": [
        {"id": 1, "position_ned_m": [0, 0, -400], "heading_deg": 0, "waypoints_ned_m": [[0, 0, 0]]}
    ],
}
"""What a study without a scenario takes its settings from; its encounters say who flies."""


def load_study(source: str | PathLike[str] | Mapping[str, Any] | Study) -> Study:
    """A study: a TOML file by path, a table as of TOML, or a Study.

    Paths in a file are looked for beside it.

    Raises:
        StudyError: it is not found, not TOML, or not a possible study; file, key and remedy.
        ArgumentError: it is nothing of the kind.

    """
    require(source, (str, PathLike, Mapping, Study), "study", "a TOML file, a table or a Study")
    if isinstance(source, Study):
        return _checked(source, source.name)
    if isinstance(source, Mapping):
        return _checked(_study_of(source, "study"), "study")
    said = str(source)
    study = _study_of(_table_of(said), said)
    return _checked(_beside(study, Path(said).resolve().parent), said)


def _table_of(said: str) -> dict[str, Any]:
    try:
        text = file_text(Path(said), said, MAX_BYTES, "a study", "TOML file")
    except ScenarioError as error:
        raise StudyError(str(error)) from error
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise StudyError(f"{said}: cannot be read: {why}; name a study file") from error
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{said}: not valid TOML: {error}") from error


def base_scenario(study: Study) -> Scenario:
    """The scenario that all runs begin with; raises ScenarioError."""
    return load_scenario(study.scenario or PLAIN, study.set, study.faults)


def _study_of(table: Mapping[str, Any], said: str) -> Study:
    try:
        return msgspec.convert(table, Study)
    except msgspec.ValidationError as error:
        raise StudyError(f"{said}: {plainly(str(error), FORMS)}") from error


def _beside(study: Study, folder: Path) -> Study:
    """The study with paths that do not depend on the working directory."""
    replace = msgspec.structs.replace
    if study.scenario and study.scenario not in packaged():
        study = replace(study, scenario=str(folder / study.scenario))
    if isinstance(study.encounters, ScenarioFiles):
        paths = tuple(p if p in packaged() else str(folder / p) for p in study.encounters.paths)
        study = replace(study, encounters=replace(study.encounters, paths=paths))
    return study


def _checked(study: Study, said: str) -> Study:
    problem = next(_problems(study), "")
    if problem:
        raise StudyError(f"{said}: {problem}")
    return study


def _problems(study: Study) -> Iterator[str]:
    """What types cannot say, as `key: what; remedy`."""
    yield from problems_of(study)
    try:
        base = base_scenario(study)
    except ScenarioError as error:
        yield str(error)
        return
    yield from _run_problems(study, base, cells_of(study))


def _run_problems(study: Study, base: Scenario, cells: Sequence[Cell]) -> Iterator[str]:
    """What is wrong with the first run of any cell, or with any of the first runs of one."""
    tried = [(cell, 0) for cell in cells] + [(cells[0], n) for n in range(1, TRIED)]
    for cell, number in tried:
        try:
            load_resolver(scenario_of_run(study, base, cell, number))
        except (ScenarioError, ValueError) as error:
            where = f"run {number} of cell {cell.number} ({cell.text})"
            yield f"{where} cannot be flown: {error}"
