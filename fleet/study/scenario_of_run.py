"""The scenario of one run of a study: the cell's settings and faults, the run's encounter."""

from __future__ import annotations

import msgspec

from fleet.config.checks import problem_with
from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError
from fleet.study.design import Cell
from fleet.study.encounters.encounter_kind import DrawnEncounter, dice_of, fault_seed
from fleet.study.study_file import Study


def cell_scenario(base: Scenario, cell: Cell) -> Scenario:
    """The scenario of a study with the settings and faults of a cell; raises ScenarioError."""
    return load_scenario(base, cell.settings, cell.faults)


def drawn_encounter(study: Study, base: Scenario, number: int) -> DrawnEncounter:
    """The encounter of run `number`, the same in all cells; raises ScenarioError."""
    return study.encounters.drawn(dice_of(study.seed, number), number, base)


def with_encounter(
    study: Study, cell: Cell, scenario: Scenario, found: DrawnEncounter, number: int
) -> Scenario:
    """The scenario of a cell with the encounter of run `number`.

    A duration that the study or the cell sets is kept, whatever the encounter's is.

    Raises:
        ScenarioError: the two do not go together, as where a UAV is faster than the cell allows.

    """
    seed = fault_seed(study.seed, number)
    flown = msgspec.structs.replace(scenario, name=f"{study.name}-{number}", seed=seed)
    if found.duration_s is not None and "duration_s" not in {**study.set, **cell.settings}:
        flown = msgspec.structs.replace(flown, duration_s=found.duration_s)
    if found.uavs or found.generate:
        flown = msgspec.structs.replace(flown, uav=found.uavs, generate=found.generate)
    problem = problem_with(flown)
    if problem:
        raise ScenarioError(problem)
    return flown


def scenario_of_run(study: Study, base: Scenario, cell: Cell, number: int) -> Scenario:
    """The scenario of run `number` in a cell, from the study's base; raises ScenarioError."""
    encounter = drawn_encounter(study, base, number)
    return with_encounter(study, cell, cell_scenario(base, cell), encounter, number)
