"""All that is left to chance in a run, as independent standard normal numbers.

The first coordinates are the random numbers of the encounter. The others are seeds: of what the
encounter draws beyond them, of the scenario, and of each fault rule in each window of time. A rule
is cut in windows so that chance can be changed at one time and stay at all others; what goes on
from one tick to the next, as a burst does, stays in one piece.
"""

from __future__ import annotations

import hashlib
import math
import random
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from fleet.config.checks import problem_with
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError, StudyError
from fleet.faults.links import LinkRule
from fleet.faults.rules import Rule
from fleet.model.elementary import erfc
from fleet.model.types import Array
from fleet.study.design import Cell
from fleet.study.encounters.scenario_files import ScenarioFiles
from fleet.study.loading import base_scenario
from fleet.study.scenario_of_run import cell_scenario, drawn_encounter, with_encounter
from fleet.study.study_file import Study

ENCOUNTER_COORDINATES = 16
WINDOW_S = 5.0
MOST_COORDINATES = 10_000


class PointDice(random.Random):
    """Random numbers that are given, and after them those of a seed."""

    def __init__(self, uniforms: Sequence[float], seed: int) -> None:
        super().__init__(seed)
        self._given = iter(uniforms)

    def random(self) -> float:
        """Uniform in (0, 1)."""
        found = next(self._given, None)
        return super().random() if found is None else found


@dataclass(frozen=True)
class StressSpace:
    """What a point in standard normal space stands for: a scenario of a cell of a study."""

    study: Study
    cell: Cell
    base: Scenario
    scenario: Scenario
    seeds: int

    @property
    def dimensions(self) -> int:
        """How many coordinates a point has; the last `seeds` of them are seeds."""
        return ENCOUNTER_COORDINATES + self.seeds

    def scenario_at(self, point: Array) -> Scenario:
        """The scenario of a point, shape (dimensions,); raises ScenarioError if none is there."""
        seeds = iter([seed_of(float(z)) for z in point[ENCOUNTER_COORDINATES:]])
        uniforms = [_uniform(float(z)) for z in point[:ENCOUNTER_COORDINATES]]
        dice, seed = PointDice(uniforms, next(seeds)), next(seeds)
        drawn = self.study.encounters.drawn(dice, 0, self.base)
        flown = with_encounter(self.study, self.cell, self.scenario, drawn, 0)
        flown = replace(flown, seed=seed)
        flown = replace(flown, fault=tuple(_seeded(flown, seeds)))
        problem = problem_with(flown)
        if problem:
            raise ScenarioError(problem)
        return flown


def stress_space(study: Study, cell: Cell) -> StressSpace:
    """The space of a cell; raises StudyError if its chance cannot be had as coordinates."""
    if getattr(study.encounters, "near", None):
        raise StudyError("encounters.near: draws have weights; leave it out to stress a study")
    if isinstance(study.encounters, ScenarioFiles) and len(study.encounters.paths) > 1:
        raise StudyError(
            "encounters.paths: which file is flown is no chance; name the one to stress"
        )
    base = base_scenario(study)
    scenario = cell_scenario(base, cell)
    sample = with_encounter(study, cell, scenario, drawn_encounter(study, base, 0), 0)
    seeds = 2 + sum(len(list(_parts(rule, sample.duration_s))) for rule in sample.fault)
    if seeds > MOST_COORDINATES:
        raise StudyError(f"{seeds} windows of fault rules, of at most {MOST_COORDINATES}")
    return StressSpace(study, cell, base, scenario, seeds)


def seed_of(coordinate: float) -> int:
    """A seed that has nothing to do with those of other coordinates: 63 bits of BLAKE2b."""
    digest = hashlib.blake2b(struct.pack("<d", coordinate), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1


def _seeded(scenario: Scenario, seeds: Iterator[int]) -> Iterator[Rule]:
    for rule in scenario.fault:
        for part in _parts(rule, scenario.duration_s):
            yield replace(part, seed=next(seeds))


def _parts(rule: Rule, duration_s: float) -> Iterator[Rule]:
    """The rule window by window, or whole."""
    end_s = duration_s if rule.end_s is None else min(rule.end_s, duration_s)
    if not isinstance(rule, LinkRule) or rule.remembers or end_s <= rule.start_s:
        yield rule
        return
    count = math.ceil((end_s - rule.start_s) / WINDOW_S)
    for n in range(count):
        start_s = rule.start_s + n * WINDOW_S
        last = n == count - 1
        yield replace(rule, start_s=start_s, end_s=rule.end_s if last else start_s + WINDOW_S)


def _uniform(coordinate: float) -> float:
    """The standard normal distribution function, never quite 0 or 1."""
    return min(max(0.5 * erfc(-coordinate / math.sqrt(2.0)), 1e-300), 1.0 - 1e-16)
