"""The smallest faults that make an encounter lose separation: examples, and no probabilities.

The factors of the study that have bounds are varied for one encounter with its fault draws. What is
sought is the point nearest the lower bounds, each factor measured by its range, at which the event
happens; where it does not, the point at which it nearly does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct

from fleet.config.scenario import Scenario
from fleet.errors import FailedError, StudyError
from fleet.extras import import_extra
from fleet.model.types import Array
from fleet.simulation.worker_pool import WorkerPool
from fleet.study.design import Cell, drawn_levels
from fleet.study.loading import base_scenario
from fleet.study.scenario_of_run import scenario_of_run
from fleet.study.study_file import Study
from fleet.study.study_run import StudyEvent, margin_of

POPULATION, STALE = 8, 1e-3
"""Points a factor and generation, and the spread at which the optimiser is content."""
NOT_HAPPENING = 2.0
"""Added where the event does not happen: more than any that does."""


class SearchOrder(Struct, frozen=True):
    """A point to be flown: numbers of the factors that are varied, for a run of a study."""

    study: bytes
    run: int
    event: StudyEvent
    numbers: tuple[float, ...]


@dataclass(frozen=True)
class FoundFault:
    """The smallest that was found: the levels, how near the event is to happening, the scenario.

    `size` is the root mean square of the factors, each from 0 at its lower bound to 1. The event
    happens if `margin`, the least separation by what it needs less 1, is below 0.
    """

    cell: Cell
    size: float
    margin: float
    scenario: Scenario
    flown: int

    @property
    def happens(self) -> bool:
        """Whether the event does."""
        return self.margin < 0.0


def search(
    study: Study,
    run: int,
    event: StudyEvent = "lost",
    generations: int = 20,
    *,
    jobs: int = 1,
    progress: Callable[[int], None] = lambda _: None,
) -> FoundFault:
    """The smallest fault for encounter `run` of a study, by differential evolution.

    It is deterministic; `progress` is called with how many runs were flown.

    Raises:
        StudyError: no factor has bounds, or the others have more than one level.
        FailedError: a worker was killed. ScenarioError: a point cannot be flown.
        MissingExtraError: SciPy is not installed.

    """
    bounds = bounds_of(study)
    optimize = import_extra("scipy.optimize", "study", "a search")
    text, margins = msgspec.json.encode(study), dict[tuple[float, ...], float]()

    def values(_function: Any, points: Sequence[Array]) -> list[float]:
        """Of points (n, factors) in the unit cube; in place of a map of the optimiser."""
        wanted = {_numbers(point, bounds) for point in points} - margins.keys()
        orders = [SearchOrder(text, run, event, numbers) for numbers in sorted(wanted)]
        for order, margin in pool.each(fly_numbers, orders, 4):
            margins[order.numbers] = margin
            progress(len(margins))
        return [_worth(point, margins[_numbers(point, bounds)]) for point in points]

    try:
        with WorkerPool(jobs) as pool:
            found = optimize.differential_evolution(
                lambda _: 0.0,
                [(0.0, 1.0)] * len(bounds),
                x0=np.zeros(len(bounds)),  # it may happen without any fault
                maxiter=generations,
                popsize=POPULATION,
                rng=study.seed,
                tol=STALE,
                updating="deferred",
                polish=False,
                workers=values,
            )
    except BrokenProcessPool as error:
        raise FailedError("a worker process was killed: try again with fewer --jobs") from error
    numbers = _numbers(found.x, bounds)
    cell = Cell(0, tuple(drawn_levels(study, numbers)))
    scenario = scenario_of_run(study, base_scenario(study), cell, run)
    return FoundFault(cell, _size(found.x), margins[numbers], scenario, len(margins))


def bounds_of(study: Study) -> list[tuple[float, float]]:
    """Bounds of the factors that are varied; raises StudyError if there are none, or levels."""
    bounds = [(f.low, f.high) for f in study.factor if f.low is not None and f.high is not None]
    if not bounds or len(bounds) < len(study.factor):
        raise StudyError("factor: a search varies factors that have low and high, and only such")
    return bounds


def fly_numbers(order: SearchOrder) -> float:
    """The margin of a point: the least separation by what the event needs, less 1."""
    study, base = _parts(order.study)
    cell = Cell(0, tuple(drawn_levels(study, order.numbers)))
    scenario = scenario_of_run(study, base, cell, order.run)
    return margin_of(scenario, study, order.event)


@lru_cache(maxsize=2)
def _parts(text: bytes) -> tuple[Study, Scenario]:
    study = msgspec.json.decode(text, type=Study)
    return study, base_scenario(study)


def _numbers(point: Array, bounds: Sequence[tuple[float, float]]) -> tuple[float, ...]:
    return tuple(
        low + float(x) * (high - low) for x, (low, high) in zip(point, bounds, strict=True)
    )


def _size(point: Array) -> float:
    return float(np.sqrt(np.mean(point * point)))


def _worth(point: Array, margin: float) -> float:
    """What is made least: the size where the event happens, else how far it is from happening."""
    return _size(point) if margin < 0.0 else NOT_HAPPENING + margin
