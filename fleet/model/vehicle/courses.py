"""Courses: where UAVs start and what each flies to, as arrays, for whole batches of predictions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from msgspec.structs import astuple
from numpy.typing import NDArray

from fleet.model.types import Array
from fleet.model.vehicle.course_changes import CourseChanges, course_changes
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.intent import Intent
from fleet.model.vehicle.speed_changes import STEADY_MPS


@dataclass(frozen=True, slots=True)
class Courses:
    """m courses as arrays of shape (m,): where each starts and what it aims at.

    `sense` is that of the turns, 0 for the shorter way (None: of all). `intent_speed_mps` is NaN
    where the speed is kept (None: by all).
    """

    north_m: Array
    east_m: Array
    down_m: Array
    speed_mps: Array
    heading_rad: Array
    flight_path_rad: Array
    intent_heading_rad: Array
    intent_climb_mps: Array
    level_down_m: Array
    sense: Array | None = None
    later: CourseChanges | None = None
    intent_speed_mps: Array | None = None

    def __len__(self) -> int:
        """Number of courses."""
        return len(self.north_m)

    def rows(self, which: NDArray[np.intp]) -> Courses:
        """Some of them, without what they change to later."""
        out = Courses(*[getattr(self, name)[which] for name in _COLUMNS])
        if self.sense is None and self.intent_speed_mps is None:
            return out
        sense = None if self.sense is None else self.sense[which]
        speed = None if self.intent_speed_mps is None else self.intent_speed_mps[which]
        return replace(out, sense=sense, intent_speed_mps=speed)

    def turns_rad(self) -> Array:
        """The turn that each begins with, right positive, shape (m,)."""
        # Into (-pi, pi], as the controller does: half a turn goes to the right.
        left = np.remainder(np.pi - (self.intent_heading_rad - self.heading_rad), math.tau)
        turn: Array = np.pi - left
        if self.sense is not None:
            turn += math.tau * self.sense * (self.sense * turn < 0.0)
        return turn

    def climbs_mps(self, level_off_s: Array, down_m: Array | None = None) -> Array:
        """The vertical speed (up positive) commanded at the start of each, or when down is so.

        All of shape (m,); `level_off_s` are the time constants with which they level off.
        """
        wanted = ((self.down_m if down_m is None else down_m) - self.level_down_m) / level_off_s
        most = np.abs(self.intent_climb_mps)
        bounded = np.minimum(np.maximum(wanted, -most), most)
        return np.where(np.isnan(wanted), self.intent_climb_mps, bounded)


_COLUMNS = tuple(f.name for f in fields(Courses))[:9]
_SPEED = _COLUMNS.index("speed_mps")


def courses(pairs: Iterable[tuple[State, Intent]]) -> Courses:
    """One course for each (state, aim)."""
    pairs = list(pairs)
    flat: list[float] = []
    for s, a in pairs:
        flat += astuple(s)
        flat += (a.heading_rad, a.climb_mps, a.level_down_m, a.speed_mps)
    table = np.array(flat, dtype=np.float64).reshape(len(pairs), len(_COLUMNS) + 1).T.copy()
    later, speeds = course_changes([a for _, a in pairs]), table[-1]
    changing = np.abs(speeds - table[_SPEED]) > STEADY_MPS
    told = np.where(changing, speeds, math.nan) if changing.any() else None
    values: list[Any] = [*table[:-1], None, later, told]
    return Courses(*values)
