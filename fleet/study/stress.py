"""Rare events of a study: small probabilities, by subset simulation over all left to chance."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import lru_cache

import msgspec
import numpy as np
from msgspec import Struct

from fleet.config.scenario import Scenario
from fleet.errors import FailedError
from fleet.model.types import Array
from fleet.simulation.worker_pool import WorkerPool
from fleet.study.design import cells_of
from fleet.study.statistics.subset import RareEvent, SubsetPlan, subset_simulation
from fleet.study.stress_space import StressSpace, stress_space
from fleet.study.study_file import Study
from fleet.study.study_run import StudyEvent, margin_of

POINTS_TOGETHER = 8
"""So many points are handed to a worker at a time."""
EXAMPLES = 10


class PointOrder(Struct, frozen=True):
    """Points to be flown in a cell of a study: rows of float64, as bytes."""

    study: bytes
    cell: int
    event: StudyEvent
    points: bytes


@dataclass(frozen=True)
class StressedCell:
    """What stressing a cell came to, and the scenarios in which the event was nearest, or worst."""

    event: RareEvent
    examples: tuple[tuple[float, Scenario], ...]


@dataclass
class _Flights:
    """Evaluates points by flying them, and remembers the worst."""

    pool: WorkerPool
    study: Study
    cell: int
    which: StudyEvent
    progress: Callable[[int], None]
    flown: int = 0
    worst: list[tuple[float, bytes]] = field(default_factory=list)

    def limit(self, points: Array) -> Array:
        text, values = msgspec.json.encode(self.study), np.empty(len(points))
        rows = range(0, len(points), POINTS_TOGETHER)
        orders = {
            PointOrder(text, self.cell, self.which, points[n : n + POINTS_TOGETHER].tobytes()): n
            for n in rows
        }
        for order, found in self.pool.each(fly_points, orders, 2):
            first = orders[order]
            values[first : first + len(found)] = found
            self.flown += len(found)
            self.progress(self.flown)
        known = self.worst + [(float(v), p.tobytes()) for v, p in zip(values, points, strict=True)]
        self.worst = sorted(set(known))[:EXAMPLES]
        return values


def stress(
    study: Study,
    cell: int,
    event: StudyEvent = "lost",
    plan: SubsetPlan | None = None,
    *,
    jobs: int = 1,
    progress: Callable[[int], None] = lambda _: None,
) -> StressedCell:
    """The probability of an event in a run of a cell, however small, with its interval.

    `progress` is called with how many runs were flown.

    Raises:
        StudyError: the study cannot be stressed. FailedError: a worker was killed.
        ScenarioError: a scenario that was drawn cannot be flown.

    """
    space = stress_space(study, cells_of(study)[cell])
    try:
        with WorkerPool(jobs) as pool:
            flights = _Flights(pool, study, cell, event, progress)
            found = subset_simulation(
                flights.limit,
                space.dimensions,
                study.seed,
                plan or SubsetPlan(),
                redrawn=space.seeds,
            )
    except BrokenProcessPool as error:
        raise FailedError(
            "a worker process was killed (is there memory enough?): try again with fewer --jobs"
        ) from error
    examples = [(value, space.scenario_at(np.frombuffer(p))) for value, p in flights.worst]
    return StressedCell(found, tuple(examples))


def fly_points(order: PointOrder) -> list[float]:
    """The performance at each point: least separation by what the event needs, less 1."""
    space = _space(order.study, order.cell)
    points = np.frombuffer(order.points).reshape(-1, space.dimensions)
    return [margin_of(space.scenario_at(p), space.study, order.event) for p in points]


@lru_cache(maxsize=2)
def _space(text: bytes, cell: int) -> StressSpace:
    study = msgspec.json.decode(text, type=Study)
    return stress_space(study, cells_of(study)[cell])
