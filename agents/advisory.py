"""The interface of a resolver: what it is given, and the advisories that it gives.

A resolver is asked once a round, by the computing UAV, with all that it knows; it answers with
advisories for other UAVs (or its own). It must be a pure function of the situation.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from fleet.model.conflict.risk import FAR
from fleet.model.conflict.tracks import ActiveManoeuvre, StateReport
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent


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
class Candidate:
    """A manoeuvre that a UAV could be commanded to fly, and what the resolver found of it.

    `turn_rad` is the change of guidance's heading (tc), `climb_mps` the climb (cc) that levels off
    at `level_down_m`; or a speed. Found, from the start of the command: whether it is `safe`; when
    zones first overlap if it is flown (inf: not at all); the least normalised separation; its cost,
    of which the least is best. NaN: not told.
    """

    manoeuvre: str
    turn_rad: float = 0.0
    climb_mps: float = 0.0
    level_down_m: float = math.nan
    speed_mps: float = math.nan
    safe: bool = False
    first_overlap_s: float = math.nan
    least_separation: float = math.nan
    cost: float = math.nan

    def judged(
        self, *, safe: bool, first_overlap_s: float, least_separation: float, cost: float
    ) -> Candidate:
        """The same with what was found of it."""
        return Candidate(
            self.manoeuvre,
            self.turn_rad,
            self.climb_mps,
            self.level_down_m,
            self.speed_mps,
            safe,
            first_overlap_s,
            least_separation,
            cost,
        )


@dataclass(frozen=True, slots=True)
class Advisory:
    """What one UAV should do: turn, climb, turn_climb, speed, resume, or keep its present one.

    `heading_rad` is absolute, `turn_rad` its difference from guidance's heading (tc; NaN: it is
    worked out); a climb levels off at `level_down_m`, or by default at the highest or lowest
    altitude allowed; `speed` flies the plan at `speed_mps`. The rest
    explains the choice and goes to the log, with the `candidates` that it was chosen from. A
    `least_separation` below 1 is a conflict that is left unresolved; by default nobody is predicted
    to come near.
    """

    target: int
    manoeuvre: str
    heading_rad: float = 0.0
    turn_rad: float = math.nan
    climb_mps: float = 0.0
    level_down_m: float = math.nan
    sector: str = ""
    collision_angle_rad: float = 0.0
    time_to_violation_s: float = 0.0
    stage: str = ""
    least_separation: float = FAR
    manoeuvre_s: float = 0.0
    intercept_s: float = 0.0
    speed_mps: float = math.nan
    candidates: tuple[Candidate, ...] = ()

    @property
    def unresolved(self) -> bool:
        """Whether a loss of separation is predicted all the same."""
        return self.least_separation < 1.0


class Resolver(Protocol):
    """What `resolver = "module:Class"` must offer; it is built once, with the scenario."""

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        """The advisories of this round; a UAV that needs none is left out."""
        ...


@runtime_checkable
class SelectiveResolver(Resolver, Protocol):
    """A resolver that knows beforehand who cannot matter: the others are all that it is given."""

    def concerned(
        self, reports: Sequence[StateReport], group: Collection[int], now_ns: int, start_ns: int
    ) -> list[StateReport]:
        """Those of the reports, in their order, that `resolve` is to be asked with.

        All of the group are among them. What `resolve` answers must not depend on the rest.
        `now_ns` is the moment of the round, `start_ns` that when commands would start.
        """
        ...
