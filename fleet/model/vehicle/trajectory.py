"""Predicted trajectories: the mapping M(S, tc, cc, n) of eq. 5, for many UAVs and options at once.

A course is "turn at the bank limit to a heading, ramp to a climb, hold both"; optionally the climb
ends by levelling off at an altitude, as guidance does and `Predictor.climb_mps` says. It may be
followed by a second one from a given time on, as when guidance turns to the next waypoint. It
begins with a change of speed, if its aim has another one (`fleet.model.vehicle.speed_changes`).

Everything is closed form: psi being linear in time during the turn, the chord over a turned angle
a = psi - psi0 is (sin psi - sin psi0, cos psi0 - cos psi) / a times the level distance flown. That
is exact while the flight path angle is constant, and second order in it while a climb begins or
ends inside the turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import Array
from fleet.model.vehicle.course_changes import CourseChanges, course_changes
from fleet.model.vehicle.flight import Limits, State
from fleet.model.vehicle.intent import STRAIGHT, Intent
from fleet.model.vehicle.speed_changes import (
    STEADY_MPS,
    SpeedChanges,
    flown_m,
    speed_changes,
    time_to_fly_s,
)


@dataclass(frozen=True, slots=True)
class Turns:
    """The turns that m courses begin with, arrays of shape (m,): right positive."""

    angle_rad: Array
    time_s: Array
    rate_radps: Array


@dataclass(frozen=True, slots=True)
class Courses:
    """m courses as arrays of shape (m,): where each starts and what it aims at.

    `sense` is that of the turns, 0 for the shorter way (None: of all). `aim_speed_mps` is NaN where
    the speed is kept (None: by all).
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


_COLUMNS = tuple(f.name for f in fields(Courses))[:9]


def courses(pairs: Iterable[tuple[State, Intent]]) -> Courses:
    """One course for each (state, aim)."""
    pairs = list(pairs)
    rows = [
        (
            s.north_m,
            s.east_m,
            s.down_m,
            s.speed_mps,
            s.heading_rad,
            s.flight_path_rad,
            a.heading_rad,
            a.climb_mps,
            a.level_down_m,
        )
        for s, a in pairs
    ]
    table = np.array(rows, dtype=np.float64).reshape(len(rows), 9)
    made, later = Courses(*table.T.copy()), course_changes([a for _, a in pairs])
    speeds = np.array([a.speed_mps for _, a in pairs])
    steady = not (np.abs(speeds - made.speed_mps) > STEADY_MPS).any()
    if later is None and steady:
        return made
    return replace(made, later=later, intent_speed_mps=None if steady else speeds)


@dataclass(frozen=True, slots=True)
class Predictor:
    """The mapping M for one airframe; `level_off_s` is guidance's time constant at an altitude."""

    limits: Limits
    level_off_s: float

    def positions(self, course: Courses, times_s: Array) -> Array:
        """NED positions, shape (m, n, 3), at times of shape (n,) or (m, n), from each start."""
        out = self._first(course, times_s)
        due = self._due(course)
        if due is not None:
            times = np.broadcast_to(times_s, out.shape[:2])
            later = due[times[due.rows].max(axis=1) > due.after_s]
            since = times[later.rows] - later.after_s[:, None]
            if len(since):
                path = self._first(self._second(course, later), np.maximum(since, 0.0))
                out[later.rows] = np.where(since[..., None] > 0.0, path, out[later.rows])
        return out

    def _due(self, course: Courses) -> CourseChanges | None:
        """What is next, and when at the speeds that are flown."""
        later = course.later
        if later is None:
            return None
        speed = course.speed_mps[later.rows]
        if course.intent_speed_mps is None and np.abs(later.speed_mps - speed).max() <= STEADY_MPS:
            return later
        intent = speed if course.intent_speed_mps is None else course.intent_speed_mps[later.rows]
        to, told = (np.where(np.isnan(x), speed, x) for x in (intent, later.speed_mps))
        limit = self.limits.acceleration_mps2
        way = flown_m(speed, told, limit, later.after_s)
        after_s = np.where(to == told, later.after_s, time_to_fly_s(speed, to, limit, way))
        return replace(later, after_s=after_s)

    def _first(self, course: Courses, times_s: Array) -> Array:
        """Positions, as far as nothing else is next."""
        out = self._steady(course, times_s)
        change = speed_changes(
            course.speed_mps, course.intent_speed_mps, self.limits.acceleration_mps2
        )
        if change is not None:
            times = np.broadcast_to(times_s, out.shape[:2])[change.rows]
            ends = change.time_s[:, None]
            during = self._changing(course, change, np.minimum(times, ends))[..., :3]
            after = self._steady(self._changed(course, change), np.maximum(times - ends, 0.0))
            out[change.rows] = np.where((times > ends)[..., None], after, during)
        return out

    def _steady(self, course: Courses, times_s: Array) -> Array:
        """Positions at the speeds of the start."""
        if _straight_and_level(course):
            return _along(course, times_s)
        turns = self._turns(course)
        t = _with_end(turns, times_s)
        down, level, _ = self._vertical(course, t)
        return _arcs(course, turns, t, down, level)

    def states(self, course: Courses, times_s: Array) -> list[State]:
        """The state of each course after its own time, `times_s` of shape (m,)."""
        table, due = self._table(course, times_s), self._due(course)
        if due is not None:
            later = due[times_s[due.rows] > due.after_s]
            since = times_s[later.rows] - later.after_s
            if len(since):
                table[later.rows] = self._table(self._second(course, later), since)
        return [State(*row) for row in table.tolist()]

    def _table(self, course: Courses, times_s: Array) -> Array:
        """States as rows, as far as nothing else is next: shape (m, 6)."""
        table = self._steady_table(course, times_s)
        change = speed_changes(
            course.speed_mps, course.intent_speed_mps, self.limits.acceleration_mps2
        )
        if change is not None:
            times, ends = times_s[change.rows], change.time_s
            during = self._changing(course, change, np.minimum(times, ends)[:, None])[:, 0]
            after = self._steady_table(self._changed(course, change), np.maximum(times - ends, 0.0))
            table[change.rows] = np.where((times > ends)[:, None], after, during)
        return table

    def _changing(self, course: Courses, change: SpeedChanges, t: Array) -> Array:
        """States (k, n, 6) of those that change their speed, at times t (k, n) until they have.

        Climbs are flown as at the mean of both speeds.
        """
        part, mean = course.rows(change.rows), 0.5 * (change.from_mps + change.to_mps)
        turn = self._turns(part).angle_rad
        way = change.way(part.heading_rad, turn, self.limits.grip_mps2, t)
        path = np.arcsin(_clip(part.speed_mps * np.sin(part.flight_path_rad) / mean, 1.0))
        down, level, climb = self._vertical(replace(part, speed_mps=mean, flight_path_rad=path), t)
        flat = np.where(t > 0.0, level / np.where(t > 0.0, mean[:, None] * t, 1.0), 1.0)
        heading = np.remainder(way.heading_rad + np.pi, math.tau) - np.pi
        columns = (
            part.north_m[:, None] + flat * way.north_m,
            part.east_m[:, None] + flat * way.east_m,
            down,
            way.speed_mps,
            heading,
            np.arcsin(_clip(climb / way.speed_mps, 1.0)),
        )
        return np.stack(columns, axis=-1)

    def _changed(self, course: Courses, change: SpeedChanges) -> Courses:
        """The courses of those from where they have changed their speed."""
        part = course.rows(change.rows)
        start = self._changing(course, change, change.time_s[:, None])[:, 0]
        intents = (part.intent_heading_rad, part.intent_climb_mps, part.level_down_m)
        after = Courses(*[*start.T.copy(), *intents])
        if part.sense is None:
            return after
        done = np.abs(np.sin(0.5 * (part.intent_heading_rad - after.heading_rad))) < STRAIGHT
        return replace(after, sense=np.where(done, 0.0, part.sense))

    def _steady_table(self, course: Courses, times_s: Array) -> Array:
        """States as rows at the speeds of the start."""
        turns = self._turns(course)
        t = _with_end(turns, times_s[:, None])
        down, level, climb = self._vertical(course, t)
        if _straight_and_level(course):
            position = _along(course, times_s[:, None])
        else:
            position = _arcs(course, turns, t, down, level)
        heading = course.heading_rad + turns.rate_radps * np.minimum(times_s, turns.time_s)
        heading = np.remainder(heading + np.pi, math.tau) - np.pi
        path = np.arcsin(_clip(climb[:, 0] / course.speed_mps, 1.0))
        return np.column_stack([position[:, 0], course.speed_mps, heading, path])

    def _second(self, course: Courses, later: CourseChanges) -> Courses:
        """The courses that some change to, from where they are by then."""
        part = course.rows(later.rows)
        start = self._table(part, later.after_s)
        intents = (later.heading_rad, later.climb_mps, later.level_down_m, later.sense)
        second = Courses(*[*start.T.copy(), *intents])
        speed = part.intent_speed_mps
        return second if speed is None else replace(second, intent_speed_mps=speed)

    def climb_mps(self, intent: Intent, state: State) -> float:
        """Vertical speed (up positive) to command now: the intent's, or less to level off."""
        course = courses([(state, intent)])
        return float(_climbs(course, self._level_off_s(course))[0])

    def turn_time_s(self, course: Courses) -> Array:
        """How long each turn takes, shape (m,)."""
        return self._turns(course).time_s

    def _turns(self, course: Courses) -> Turns:
        # Into (-pi, pi], as the controller does: half a turn goes to the right.
        left = np.remainder(np.pi - (course.intent_heading_rad - course.heading_rad), math.tau)
        turn = np.pi - left
        if course.sense is not None:
            turn += math.tau * course.sense * (course.sense * turn < 0.0)
        limit = self.limits.turn_rate_radps(1.0) / course.speed_mps
        return Turns(turn, np.abs(turn) / limit, np.sign(turn) * limit)

    def _level_off_s(self, course: Courses) -> Array:
        """Time constant with which each climb levels off: longer where the pull is not flyable."""
        steepest = math.sin(self.limits.flight_path_rad)
        sine = np.minimum(np.abs(course.intent_climb_mps) / course.speed_mps, steepest)
        return np.maximum(self.level_off_s, sine / self.limits.flight_path_rate_radps)

    def _ramp(self, course: Courses, level_off_s: Array) -> tuple[Array, Array, Array]:
        """Final path angle, signed rate and time of the ramp to the commanded climb."""
        sine = _clip(_climbs(course, level_off_s) / course.speed_mps, 1.0)
        final = _clip(np.arcsin(sine), self.limits.flight_path_rad)
        change = final - course.flight_path_rad
        rate = np.where(change < 0, -1.0, 1.0) * self.limits.flight_path_rate_radps
        return final, rate, change / rate

    def _vertical(self, course: Courses, t: Array) -> tuple[Array, Array, Array]:
        """Down, level distance flown and climb rate at times t (m, n): ramp, climb, capture."""
        if _level(course):
            still = np.zeros_like(t)
            return course.down_m[:, None] + still, course.speed_mps[:, None] * t, still
        level_off_s = self._level_off_s(course)
        final, rate, ramp_time = (x[:, None] for x in self._ramp(course, level_off_s))
        speed, path0 = course.speed_mps[:, None], course.flight_path_rad[:, None]
        radius, climb = speed / rate, speed * np.sin(final)
        ramp = np.minimum(t, ramp_time)
        path = path0 + rate * ramp
        sine = np.sin(path)
        up = radius * (np.cos(path0) - np.cos(path))
        level = radius * (sine - np.sin(path0))
        if np.isnan(course.level_down_m).all():
            steady = t - ramp
            level += speed * np.cos(final) * steady
            return course.down_m[:, None] - up - climb * steady, level, speed * sine
        ramp_up = radius * (np.cos(path0) - np.cos(final))
        tau = level_off_s[:, None]
        left = (course.down_m - course.level_down_m)[:, None] - ramp_up
        steady_time, remaining = _capture(left, climb, tau)
        steady = np.minimum(t - ramp, steady_time)
        decay = np.maximum(t - ramp_time - steady_time, 0.0)
        left = np.exp(-decay / tau)
        up += climb * steady + remaining * (1.0 - left)
        # the level speed lost to a decaying climb w exp(-t/tau) is w^2/(2V) exp(-2t/tau)
        start = remaining / tau
        lost = start**2 * tau / (4.0 * speed) * (1.0 - left**2)
        level += speed * np.cos(final) * steady + speed * decay - lost
        captured = np.where(decay > 0.0, start * left, speed * sine)
        return course.down_m[:, None] - up, level, captured


def _climbs(course: Courses, level_off_s: Array) -> Array:
    """The vertical speed commanded at the start, shape (m,)."""
    wanted = (course.down_m - course.level_down_m) / level_off_s
    bounded = _clip(wanted, np.abs(course.intent_climb_mps))
    return np.where(np.isnan(wanted), course.intent_climb_mps, bounded)


def _capture(height: Array, climb: Array, level_off_s: Array) -> tuple[Array, Array]:
    """Time in the steady climb before levelling off, and the height left at that moment.

    `height` is what there is to climb after the ramp (NaN: the climb does not end).
    """
    endless = np.isnan(height)
    left = np.where(endless, 0.0, height)
    steady_up = left - climb * level_off_s
    moving = (steady_up * climb > 0.0) & (np.abs(climb) > STRAIGHT)
    steady = np.where(moving, steady_up / np.where(moving, climb, 1.0), 0.0)
    remaining = np.where(moving, climb * level_off_s, left)
    return np.where(endless, np.inf, steady), np.where(endless, 0.0, remaining)


def _clip(values: Array, bound: float | Array) -> Array:
    """Within [-bound, bound]; a third of the time that `np.clip` takes for a few values."""
    return np.minimum(np.maximum(values, -bound), bound)


def _straight_and_level(course: Courses) -> bool:
    """Whether nobody turns or climbs, as most of the time: not worth the general formulae."""
    climb = np.maximum(np.abs(course.flight_path_rad), np.abs(course.intent_climb_mps))
    off = np.abs(course.level_down_m - course.down_m) >= STRAIGHT
    if not climb.max() < STRAIGHT or off.any():
        return False
    turn = course.intent_heading_rad - course.heading_rad
    return bool(np.abs(np.sin(turn)).max() < STRAIGHT and np.cos(turn).min() > 0.0)


def _level(course: Courses) -> bool:
    """Whether nobody climbs, nor is to, not even a little."""
    off = np.abs(course.flight_path_rad) + np.abs(course.intent_climb_mps)
    return not (off.any() or (np.abs(course.level_down_m - course.down_m) > 0.0).any())


def _with_end(turns: Turns, times_s: Array) -> Array:
    """Times, shape (n,) or (m, n), and after them the end of each turn: shape (m, n + 1)."""
    count = np.shape(times_s)[-1]
    t = np.empty((len(turns.time_s), count + 1))
    t[:, :count] = times_s
    t[:, count] = turns.time_s
    return t


def _arcs(course: Courses, turns: Turns, t: Array, down: Array, level: Array) -> Array:
    """Positions at times t but the last, the end of the turn, given down and level distance."""
    in_arc = np.minimum(level[:, :-1], level[:, -1:])
    after = level[:, :-1] - in_arc
    # chord of an arc by the half angle: sin(a/2)/(a/2) along the mean heading
    half = 0.5 * turns.rate_radps[:, None] * np.minimum(t[:, :-1], turns.time_s[:, None])
    chord = in_arc * np.sinc(half / np.pi)
    mean = course.heading_rad[:, None] + half
    final = (course.heading_rad + turns.angle_rad)[:, None]
    out = np.empty((*half.shape, 3))
    out[..., 0] = course.north_m[:, None] + chord * np.cos(mean) + after * np.cos(final)
    out[..., 1] = course.east_m[:, None] + chord * np.sin(mean) + after * np.sin(final)
    out[..., 2] = down[:, :-1]
    return out


def _along(course: Courses, times_s: Array) -> Array:
    """Positions on straight and level courses."""
    way = course.speed_mps[:, None] * times_s
    out = np.empty((*way.shape, 3))
    out[..., 0] = course.north_m[:, None] + way * np.cos(course.heading_rad)[:, None]
    out[..., 1] = course.east_m[:, None] + way * np.sin(course.heading_rad)[:, None]
    out[..., 2] = course.down_m[:, None]
    return out
