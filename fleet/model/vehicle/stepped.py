"""Vehicle models without a closed form: how they fly for a short time is all that they say."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from fleet.model.types import Array
from fleet.model.vehicle.courses import Courses
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.model import VehicleModel

STEP_S = 0.5
"""Predictions go in steps of this length, straight on between two of them."""

STEADY = 1e-6
"""Changes in a step (m/s, rad) below this, and climbs that are to end, are none: 2 mm in 2 km."""


@dataclass(frozen=True, slots=True)
class SteppedModel(VehicleModel):
    """A model that has to say `limits` and `advance` alone; truth and prediction follow from it.

    A prediction takes a call of `advance` for each step of `STEP_S`, for all its courses together:
    some milliseconds, where closed form takes a tenth of that.
    """

    @abstractmethod
    def advance(self, states: Array, setpoints: Array, dt_s: float) -> Array:
        """The states (m, 6) of m UAVs after `dt_s`, under setpoints (m, 3), which are not passed.

        The columns are those of `State` and of `Setpoint`. The heading to fly is never more than
        half a circle away; headings need not be within half a circle of north. Each row has to come
        to the same bits whatever the others are.
        """

    def step(self, state: State, setpoint: Setpoint, dt_s: float) -> State:
        """`advance` for one UAV."""
        turn = math.remainder(setpoint.heading_rad - state.heading_rad, math.tau)
        told = (state.heading_rad + turn, setpoint.climb_mps, setpoint.speed_mps)
        (row,) = self.advance(np.array([_row(state)]), np.array([told]), dt_s).tolist()
        north, east, down, speed, heading, path = row
        return State(north, east, down, speed, math.remainder(heading, math.tau), path)

    def predict(self, course: Courses, times_s: Array) -> Array:
        """States at steps of `STEP_S`, and on the chords between them."""
        times = np.broadcast_to(times_s, (len(course), np.shape(times_s)[-1]))
        before = (times / STEP_S).astype(np.intp)
        steps = self._march(course, int(before.max(initial=0)) + 1)
        rows = np.arange(len(course))[:, None]
        start, end = steps[before, rows], steps[before + 1, rows]
        out: Array = start + (end - start) * (times / STEP_S - before)[..., None]
        out[..., 4] = np.remainder(out[..., 4] + np.pi, math.tau) - np.pi
        return out

    def _march(self, course: Courses, count: int) -> Array:
        """States (count + 1, m, 6) at steps of `STEP_S`; headings run on.

        Who is steady goes on so, and is not asked for any more.
        """
        levelling_s, final = self.levelling_s(course), course.heading_rad + course.turns_rad()
        speeds = course.speed_mps
        if course.intent_speed_mps is not None:
            told = course.intent_speed_mps
            speeds = np.where(np.isnan(told), speeds, told)
        steps = np.empty((count + 1, len(course), 6))
        steps[0] = _starts(course)
        left, part = np.arange(len(course)), course
        for k in range(count):
            before = steps[k, left]
            turn = np.clip(final[left] - before[:, 4], -0.5 * np.pi, 0.5 * np.pi)
            climbs = part.climbs_mps(levelling_s[left], before[:, 2])
            setpoints = np.stack([before[:, 4] + turn, climbs, speeds[left]], axis=1)
            steps[k + 1, left] = after = self.advance(before, setpoints, STEP_S)
            way = after - before
            climbing = np.where(np.isnan(part.level_down_m), 0.0, climbs)
            steady = np.maximum(np.abs(way[:, 3:]).max(axis=1), np.abs(climbing)) < STEADY
            if steady.any():
                more = np.arange(1.0, count - k)[:, None, None]
                steps[k + 2 :, left[steady]] = after[steady] + way[steady] * more
                left = left[~steady]
                part = course.rows(left)
            if not len(left):
                break
        return steps


def _starts(course: Courses) -> Array:
    """The states (m, 6) that courses start from."""
    columns = (course.north_m, course.east_m, course.down_m, course.speed_mps)
    return np.stack([*columns, course.heading_rad, course.flight_path_rad], axis=1)


def _row(state: State) -> tuple[float, ...]:
    return (
        state.north_m,
        state.east_m,
        state.down_m,
        state.speed_mps,
        state.heading_rad,
        state.flight_path_rad,
    )
