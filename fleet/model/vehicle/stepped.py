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
        half a circle away; headings need not be within half a circle of north.
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
        steps = self._march(course, math.ceil(times.max(initial=0.0) / STEP_S))
        before = np.minimum((times / STEP_S).astype(np.intp), len(steps) - 2)
        rows = np.arange(len(course))[:, None]
        start, end = steps[before, rows], steps[before + 1, rows]
        out: Array = start + (end - start) * (times / STEP_S - before)[..., None]
        out[..., 4] = np.remainder(out[..., 4] + np.pi, math.tau) - np.pi
        return out

    def _march(self, course: Courses, count: int) -> Array:
        """States (count + 1 or more, m, 6) at steps of `STEP_S`; headings run on."""
        columns = (course.north_m, course.east_m, course.down_m, course.speed_mps)
        states = np.stack([*columns, course.heading_rad, course.flight_path_rad], axis=1)
        speeds, levelling_s = course.speed_mps, self.levelling_s(course)
        if course.intent_speed_mps is not None:
            told = course.intent_speed_mps
            speeds = np.where(np.isnan(told), speeds, told)
        final = course.heading_rad + course.turns_rad()
        out = [states]
        while len(out) <= max(1, count):
            turn = np.clip(final - states[:, 4], -0.5 * np.pi, 0.5 * np.pi)
            climbs = course.climbs_mps(levelling_s, states[:, 2])
            setpoints = np.stack([states[:, 4] + turn, climbs, speeds], axis=1)
            states = self.advance(states, setpoints, STEP_S)
            out.append(states)
            way = states - out[-2]
            climbing = np.where(np.isnan(course.level_down_m), 0.0, climbs)
            if max(np.abs(way[:, 3:]).max(), np.abs(climbing).max()) < STEADY:
                return np.concatenate([out, states + way * _numbers(count + 1 - len(out))])
        return np.stack(out)


def _numbers(count: int) -> Array:
    """1 to a count, shape (count, 1, 1)."""
    return np.arange(1.0, count + 1.0)[:, None, None]


def _row(state: State) -> tuple[float, ...]:
    return (
        state.north_m,
        state.east_m,
        state.down_m,
        state.speed_mps,
        state.heading_rad,
        state.flight_path_rad,
    )
