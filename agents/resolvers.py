"""The interface of a resolver, and how a scenario's `resolver` name becomes one.

A resolver is asked once a round, by the computing UAV, with all that it knows; it answers with
advice for other UAVs (or its own). It must be a pure function of the situation.
"""

from __future__ import annotations

import importlib
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.machinery import PathFinder
from typing import Protocol

from fleet.config.scenario import Scenario
from fleet.model.conflict.tracks import ActiveManoeuvre
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent

FAR = 100.0
"""Normalised separation from nobody."""


BUILT_IN = ("geometric", "none")


@dataclass(frozen=True, slots=True)
class Aircraft:
    """One UAV at the moment the commands will start, as the computing UAV knows it.

    `age_s` is how old the report is that this was computed from, at the moment of the round.
    `review` is set now and then of a UAV that flies a manoeuvre: will that ever end?
    """

    id: int
    state: State
    guidance: Intent
    manoeuvre: ActiveManoeuvre | None
    plan: FlightPlan
    age_s: float = 0.0
    review: bool = False

    def __post_init__(self) -> None:
        """IDs start at 1."""
        if self.id < 1:
            raise ValueError(f"UAV ID {self.id}: IDs start at 1.")

    @property
    def cruise_mps(self) -> float:
        """The speed that its plan is flown at."""
        told = self.guidance.speed_mps
        return self.state.speed_mps if math.isnan(told) else told


@dataclass(frozen=True, slots=True)
class Situation:
    """What a resolver is given: the group, the computing UAV, all aircraft heard (ID order).

    Those in `unreachable` cannot be commanded: they are silent, do not hear or do not answer.
    """

    computing: int
    members: tuple[int, ...]
    aircraft: tuple[Aircraft, ...]
    unreachable: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Advisory:
    """What one UAV should do: turn, climb, turn_climb, speed, resume, or keep its present one.

    `heading_rad` is absolute, `turn_rad` its difference from guidance's heading (tc); a climb
    levels off at `level_down_m`, or by default at the highest or lowest altitude allowed; `speed`
    flies the plan at `speed_mps`. The rest
    explains the choice and goes to the log. A `least_separation` below 1 is a conflict that is left
    unresolved; by default nobody is predicted to come near.
    """

    target: int
    manoeuvre: str
    heading_rad: float = 0.0
    turn_rad: float = 0.0
    climb_mps: float = 0.0
    level_down_m: float = math.nan
    sector: str = ""
    collision_angle_rad: float = 0.0
    time_to_violation_s: float = 0.0
    stage: str = ""
    least_separation: float = FAR
    safe_candidates: int = 0
    manoeuvre_s: float = 0.0
    intercept_s: float = 0.0
    speed_mps: float = math.nan

    @property
    def unresolved(self) -> bool:
        """Whether a loss of separation is predicted all the same."""
        return self.least_separation < 1.0


class Resolver(Protocol):
    """What `resolver = "module:Class"` must offer; it is built once, with the scenario."""

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        """The advisories of this round; a UAV that needs none is left out."""
        ...


class NoResolver:
    """The baseline: nobody is ever told anything."""

    def __init__(self, scenario: Scenario) -> None:
        """Needs nothing of the scenario."""

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        """No advice."""
        return ()


def code_behind(name: str) -> str:
    """What would be imported for a resolver of this name, and from where; empty if it is built in.

    Nothing is imported to find that out.
    """
    if name in BUILT_IN:
        return ""
    module = name.partition(":")[0]
    top = module.partition(".")[0]
    try:
        # As the import will find it, but its parents are not imported to look into them.
        found = PathFinder.find_spec(top, [*sys.path, os.getcwd()])
    except (OSError, ValueError, ImportError):
        found = None
    places = [found.origin, *(found.submodule_search_locations or ())] if found else []
    where = next((str(place) for place in places if place), "")
    return f"module '{module}'{f', from {where}' if where else ''}"


def load_resolver(scenario: Scenario) -> Resolver:
    """The resolver that the scenario names: `geometric`, `none` or `module:Class`.

    Raises:
        ValueError: there is no such resolver; the message says what was tried.

    """
    name = scenario.resolver
    if name == "none":
        return NoResolver(scenario)
    if name == "geometric":
        from fleet.agents.geometric import GeometricResolver  # noqa: PLC0415

        return GeometricResolver(scenario)
    module, _, attribute = name.partition(":")
    if not module or not attribute:
        raise ValueError(f"resolver '{name}': use 'geometric', 'none' or 'module:Class'")
    try:
        if os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())
        made = getattr(importlib.import_module(module), attribute)(scenario)
    except Exception as error:  # user code: whatever it raises is the user's to mend
        why = f"{type(error).__name__}: {error}"
        raise ValueError(f"resolver '{name}' cannot be loaded ({why})") from error
    if not callable(getattr(made, "resolve", None)):
        raise ValueError(f"resolver '{name}' has no method resolve(situation)")
    resolver: Resolver = made
    return resolver
