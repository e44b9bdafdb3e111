"""What courses change to after a time, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import Array
from fleet.model.vehicle.intent import Intent


@dataclass(frozen=True, slots=True)
class CourseChanges:
    """What k of m courses change to: their rows, and arrays of shape (k,)."""

    rows: NDArray[np.intp]
    after_s: Array
    heading_rad: Array
    climb_mps: Array
    level_down_m: Array
    sense: Array
    speed_mps: Array

    def __getitem__(self, which: NDArray[np.bool_]) -> CourseChanges:
        """Some of them."""
        return CourseChanges(
            self.rows[which],
            self.after_s[which],
            self.heading_rad[which],
            self.climb_mps[which],
            self.level_down_m[which],
            self.sense[which],
            self.speed_mps[which],
        )


def course_changes(intents: list[Intent]) -> CourseChanges | None:
    """What those of some intents change to that bend; None if none does."""
    bent = [(n, a.then) for n, a in enumerate(intents) if a.then is not None and a.bends]
    if not bent:
        return None
    values = [
        (t.after_s, t.heading_rad, t.climb_mps, t.level_down_m, t.sense, t.speed_mps)
        for _, t in bent
    ]
    table = np.array(values, dtype=np.float64)
    return CourseChanges(np.array([n for n, _ in bent], dtype=np.intp), *table.T.copy())
