"""Tracks: what one process knows of the others from the broadcasts it heard."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from fleet.model.flight import State
from fleet.model.guidance import Plan
from fleet.model.trajectory import Aim, Array, Courses, Predictor, courses
from fleet.model.units import to_s


class CommandId(Struct, frozen=True, gc=False):
    """Identity of a command: term, issuer, number. All zero: none."""

    term: int = 0
    issuer: int = 0
    number: int = 0

    def __bool__(self) -> bool:
        """Whether it names a command."""
        return self.number > 0


NO_COMMAND = CommandId()


class Escape(Struct, frozen=True, gc=False):
    """A manoeuvre being flown instead of guidance's: turn, climb or turn_climb."""

    manoeuvre: str
    heading_rad: float
    climb_mps: float


class Report(Struct, frozen=True, gc=False):
    """What a UAV last said of itself: state, what guidance wants, and what escape it flies.

    Of the plan a broadcast tells only the active waypoint.
    """

    id: int
    t_ns: int
    state: State
    guidance: Aim
    plan: Plan
    escape: Escape | None = None
    command: CommandId = NO_COMMAND

    def aim(self) -> Aim:
        """What it flies now."""
        return aim_of(self.guidance, self.escape)


def aim_of(guidance: Aim, escape: Escape | None) -> Aim:
    """The aim of an escape: guidance's, but for the axes that the escape takes over."""
    if escape is None:
        return guidance
    turning = escape.manoeuvre in ("turn", "turn_climb")
    climbing = escape.manoeuvre in ("climb", "turn_climb")
    return Aim(
        escape.heading_rad if turning else guidance.heading_rad,
        escape.climb_mps if climbing else guidance.climb_mps,
        math.nan if climbing else guidance.level_down_m,
    )


class Tracks:
    """The latest report of every UAV heard, by ID; older reports never replace newer ones."""

    def __init__(self) -> None:
        self._reports: dict[int, Report] = {}

    def hear(self, report: Report) -> None:
        """Take in a report."""
        known = self._reports.get(report.id)
        if known is None or report.t_ns > known.t_ns:
            self._reports[report.id] = report

    def fresh(self, now_ns: int, timeout_ns: int) -> list[Report]:
        """Reports not older than the time-out, in ID order."""
        ids = sorted(self._reports)
        return [r for r in (self._reports[i] for i in ids) if now_ns - r.t_ns <= timeout_ns]


def ages_s(reports: Sequence[Report], now_ns: int) -> Array:
    """Age of each report at `now_ns`, shape (m,)."""
    return np.array([to_s(now_ns - r.t_ns) for r in reports])


def states_at(reports: Sequence[Report], now_ns: int, predictor: Predictor) -> list[State]:
    """Dead-reckoned states: each UAV flown from its report along what it said it flies."""
    course = courses((r.state, r.aim()) for r in reports)
    return predictor.states(course, ages_s(reports, now_ns))


def courses_of(states: Sequence[State], aims: Sequence[Aim]) -> Courses:
    """Courses of several UAVs from given states."""
    return courses(zip(states, aims, strict=True))
