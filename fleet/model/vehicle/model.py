"""The interface of a vehicle model: how a UAV flies, and how its flight is predicted.

A `Performance` is what a scenario says of it: the table `[performance]`, its keys in the units of
scenarios. It makes the `VehicleModel`, in SI units and radians, that everybody asks who flies the
UAV, guides it, or predicts it. A model has no memory: all that it is in is the `State`, which is
what broadcasts and the log tell, so that others predict it as well as it does itself, and it is
flown on where its process has died.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from fleet.model.elementary import sin
from fleet.model.types import Array
from fleet.model.vehicle.corridors import Corridor
from fleet.model.vehicle.course_changes import CourseChanges
from fleet.model.vehicle.courses import Courses, courses
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.intent import Intent
from fleet.model.vehicle.limits import Limits
from fleet.model.vehicle.speed_changes import STEADY_MPS, flown_m, time_to_fly_s

LEAST_AIRSPEED_MPS = 1.0
"""A slower airspeed is none."""


@dataclass(frozen=True, slots=True)
class VehicleModel(ABC):
    """How a vehicle flies. It has to say `limits`, `step` and `predict`; the rest follows.

    `level_off_s` is the time constant with which guidance levels off at an altitude.
    """

    limits: Limits
    level_off_s: float

    @abstractmethod
    def step(self, state: State, setpoint: Setpoint, dt_s: float) -> State:
        """The state `dt_s` later (dt_s > 0, a tick or 0.2 s or less) under a setpoint.

        A pure function: the same for the same state, setpoint and time.
        """

    @abstractmethod
    def predict(self, course: Courses, times_s: Array) -> Array:
        """States on m courses at times of shape (n,) or (m, n), from each start: (m, n, 6).

        The columns are those of `State`. What a course changes to later is not looked at. What is
        predicted of a course at a time is the same to the last bit whatever else is asked with it.
        """

    def places(self, course: Courses, times_s: Array) -> Array:
        """The positions of `predict`, shape (m, n, 3); for models that have them cheaper."""
        return self.predict(course, times_s)[..., :3]

    def positions(self, course: Courses, times_s: Array) -> Array:
        """NED positions, shape (m, n, 3), at times of shape (n,) or (m, n), from each start."""
        out = self.places(course, times_s)
        due = self._due(course)
        if due is not None:
            times = np.broadcast_to(times_s, out.shape[:2])
            soon = times[due.rows].max(axis=1) > due.after_s
            if soon.any():
                later = due[soon]
                since = times[later.rows] - later.after_s[:, None]
                path = self.places(self._second(course, later), np.maximum(since, 0.0))
                out[later.rows] = np.where(since[..., None] > 0.0, path, out[later.rows])
        return out

    def states(self, course: Courses, times_s: Array) -> list[State]:
        """The state of each course after its own time, `times_s` of shape (m,)."""
        table, due = self.predict(course, times_s[:, None])[:, 0], self._due(course)
        if due is not None:
            soon = times_s[due.rows] > due.after_s
            if soon.any():
                later = due[soon]
                since = times_s[later.rows] - later.after_s
                second = self._second(course, later)
                table[later.rows] = self.predict(second, since[:, None])[:, 0]
        table += 0.0  # the sign of a zero, which `np.maximum` and `np.minimum` leave open, is +
        return [State(*row) for row in table.tolist()]

    def after(self, state: State, intent: Intent, time_s: float) -> State:
        """The state of one course after a time."""
        return self.states(courses([(state, intent)]), np.array([time_s]))[0]

    def straight(self, course: Courses) -> NDArray[np.bool_]:
        """Which courses are flown straight on and level at the speed of their start, shape (m,).

        A model that says so of none is right, and its flights are compared by samples.
        """
        return np.zeros(len(course), dtype=np.bool_)

    def corridor(
        self,
        state: State,
        intent: Intent,
        age_s: float,
        horizon_s: float,
        *,
        otherwise_s: float = 0.0,
    ) -> Corridor | None:
        """A corridor from `age_s` after the state on, for the horizon; None: not known.

        It holds for the first `otherwise_s` after the state being flown in any other way, and for
        the same course predicted from any state on it. A model that knows of none is right, and its
        flights are compared by samples.
        """
        return None

    def climb_mps(self, intent: Intent, state: State) -> float:
        """Vertical speed (up positive) to command now: the intent's, or less to level off."""
        course = courses([(state, intent)])
        return float(course.climbs_mps(self.levelling_s(course))[0]) + 0.0

    def levelling_s(self, course: Courses) -> Array:
        """Time constant with which each climb levels off: longer where the pull is not flyable."""
        out = []
        pairs = zip(course.speed_mps.tolist(), course.intent_climb_mps.tolist(), strict=True)
        for speed, climb in pairs:
            sine = min(abs(climb) / speed, sin(self.limits.steepest_rad(speed)))
            out.append(max(self.level_off_s, sine / self.limits.pitch_rate_radps(speed)))
        return np.array(out)

    def turn_time_s(self, course: Courses) -> Array:
        """How long the turn takes that each course begins with, shape (m,)."""
        rates = [self.limits.turn_rate_radps(speed) for speed in course.speed_mps.tolist()]
        times_s: Array = np.abs(course.turns_rad()) / np.array(rates)
        return times_s

    def _due(self, course: Courses) -> CourseChanges | None:
        """What is next, and when at the speeds that are flown."""
        later = course.later
        if later is None:
            return None
        speed = course.speed_mps[later.rows]
        if course.intent_speed_mps is None and np.abs(later.speed_mps - speed).max() <= STEADY_MPS:
            return later  # as nearly always: the same, for less
        intent = speed if course.intent_speed_mps is None else course.intent_speed_mps[later.rows]
        to, told = (np.where(np.isnan(x), speed, x) for x in (intent, later.speed_mps))
        limit = self.limits.acceleration_mps2
        way = flown_m(speed, told, limit, later.after_s)
        other = np.abs(told - to) > STEADY_MPS
        after_s = np.where(other, time_to_fly_s(speed, to, limit, way), later.after_s)
        return replace(later, after_s=after_s)

    def _second(self, course: Courses, later: CourseChanges) -> Courses:
        """The courses that some change to, from where they are by then."""
        part = course.rows(later.rows)
        start = self.predict(part, later.after_s[:, None])[:, 0]
        intents = (later.heading_rad, later.climb_mps, later.level_down_m, later.sense)
        second = Courses(*[*start.T.copy(), *intents])
        speed = part.intent_speed_mps
        return second if speed is None else replace(second, intent_speed_mps=speed)


class Performance(
    Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="vehicle"
):
    """[performance]: what a UAV can fly; the key `vehicle` is the model, and each has its own keys.

    All keys have defaults.
    """

    min_speed_share: Annotated[float, Meta(ge=0.01, le=1.0)] = 0.75
    max_speed_share: Annotated[float, Meta(ge=1.0, le=1.4)] = 1.25

    def model(self, level_off_s: float) -> VehicleModel:
        """The model, with guidance's time constant of levelling off."""
        raise NotImplementedError

    def validate(self, speed_mps: float) -> Iterator[str]:
        """Problems of a UAV that cruises at this speed, as `key: what; remedy`; none by default.

        That a value is of its type and in its range is checked before. Whether waypoints and climbs
        can be flown is checked by the limits of the model.
        """
        yield from ()

    def speeds_mps(self, cruise_mps: float) -> tuple[float, float]:
        """The least and the greatest speed that it may be commanded, of this cruise speed."""
        least = max(LEAST_AIRSPEED_MPS, self.min_speed_share * cruise_mps)
        return least, self.max_speed_share * cruise_mps
