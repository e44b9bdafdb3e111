"""The vehicle model of each UAV of a fleet, and predictions of several UAVs at once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import Array
from fleet.model.vehicle.courses import Courses, courses
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.intent import Intent
from fleet.model.vehicle.model import VehicleModel


class FleetModels:
    """Models by ID; a UAV that is not known flies as the fleet does by default."""

    def __init__(self, default: VehicleModel, own: Mapping[int, VehicleModel] | None = None):
        """`own` are those that differ from the default."""
        self._default = default
        self._own = {uav: model for uav, model in (own or {}).items() if model != default}

    def of(self, uav: int) -> VehicleModel:
        """The model of a UAV."""
        return self._own.get(uav, self._default)

    def positions(
        self,
        uavs: Sequence[int],
        states: Sequence[State],
        intents: Sequence[Intent],
        times_s: Array,
    ) -> Array:
        """Where m UAVs fly from these states: NED positions, shape (m, n, 3).

        At times of shape (n,) or (m, n).
        """
        if not self._own:  # as nearly always
            return self._default.positions(courses(zip(states, intents, strict=True)), times_s)
        out = np.empty((len(uavs), np.shape(times_s)[-1], 3))
        for model, rows in self._batches(uavs):
            course = courses((states[k], intents[k]) for k in rows)
            out[rows] = model.positions(course, times_s if times_s.ndim == 1 else times_s[rows])
        return out

    def states(
        self,
        uavs: Sequence[int],
        states: Sequence[State],
        intents: Sequence[Intent],
        times_s: Array,
    ) -> list[State]:
        """The state of each of m UAVs after its own time, `times_s` of shape (m,)."""
        if not self._own:
            return self._default.states(courses(zip(states, intents, strict=True)), times_s)
        out = list(states)
        for model, rows in self._batches(uavs):
            course = courses((states[k], intents[k]) for k in rows)
            for row, state in zip(rows, model.states(course, times_s[rows]), strict=True):
                out[row] = state
        return out

    def straight(self, uavs: Sequence[int], course: Courses) -> NDArray[np.bool_]:
        """Which of m UAVs fly straight on and level at their speed, shape (m,), till what is next.

        For sure: of who is not among them it is not known.
        """
        if not self._own:
            return self._default.straight(course)
        out = np.zeros(len(uavs), dtype=np.bool_)
        for model, rows in self._batches(uavs):
            out[rows] = model.straight(course.rows(rows))
        return out

    def _batches(self, uavs: Sequence[int]) -> Iterator[tuple[VehicleModel, NDArray[np.intp]]]:
        """The rows of each model."""
        rows: defaultdict[VehicleModel, list[int]] = defaultdict(list)
        for row, uav in enumerate(uavs):
            rows[self.of(uav)].append(row)
        for model, picked in rows.items():
            yield model, np.array(picked, dtype=np.intp)
