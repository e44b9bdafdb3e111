"""Predicted trajectories: the mapping M(S, tc, cc, n) of eq. 5, for many UAVs and options at once.

A course is "turn at the bank limit to a heading, ramp to a climb, hold both"; optionally the climb
ends by levelling off at an altitude, as guidance does and `Predictor.climb_mps` says. It may be
followed by a second one from a given time on, as when guidance turns to the next waypoint.
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

from fleet.model.aims import STRAIGHT, Aim
from fleet.model.flight import Limits, State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Later:
    """What k of m courses change to: their rows, and arrays of shape (k,)."""

    rows: NDArray[np.intp]
    after_s: Array
    heading_rad: Array
    climb_mps: Array
    level_down_m: Array
    sense: Array

    def __getitem__(self, which: NDArray[np.bool_]) -> Later:
        """Some of them."""
        return Later(
            self.rows[which],
            self.after_s[which],
            self.heading_rad[which],
            self.climb_mps[which],
            self.level_down_m[which],
            self.sense[which],
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

    `sense` is that of the turns, 0 for the shorter way (None: of all).
    """

    north_m: Array
    east_m: Array
    down_m: Array
    speed_mps: Array
    heading_rad: Array
    flight_path_rad: Array
    aim_heading_rad: Array
    aim_climb_mps: Array
    level_down_m: Array
    sense: Array | None = None
    later: Later | None = None

    def __len__(self) -> int:
        """Number of courses."""
        return len(self.north_m)


_COLUMNS = tuple(f.name for f in fields(Courses))[:9]


def courses(pairs: Iterable[tuple[State, Aim]]) -> Courses:
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
    made, later = Courses(*table.T.copy()), _later([a for _, a in pairs])
    return made if later is None else replace(made, later=later)


def _later(aims: list[Aim]) -> Later | None:
    bent = [(n, a.then) for n, a in enumerate(aims) if a.then is not None and a.bends]
    if not bent:
        return None
    values = [(t.after_s, t.heading_rad, t.climb_mps, t.level_down_m, t.sense) for _, t in bent]
    table = np.array(values, dtype=np.float64)
    return Later(np.array([n for n, _ in bent], dtype=np.intp), *table.T.copy())


@dataclass(frozen=True, slots=True)
class Predictor:
    """The mapping M for one airframe; `level_off_s` is guidance's time constant at an altitude."""

    limits: Limits
    level_off_s: float

    def positions(self, course: Courses, times_s: Array) -> Array:
        """NED positions, shape (m, n, 3), at times of shape (n,) or (m, n), from each start."""
        out = self._first(course, times_s)
        if course.later is not None:
            times = np.broadcast_to(times_s, out.shape[:2])
            later = course.later[times[course.later.rows].max(axis=1) > course.later.after_s]
            since = times[later.rows] - later.after_s[:, None]
            if len(since):
                path = self._first(self._second(course, later), np.maximum(since, 0.0))
                out[later.rows] = np.where(since[..., None] > 0.0, path, out[later.rows])
        return out

    def _first(self, course: Courses, times_s: Array) -> Array:
        """Positions, as far as nothing else is next."""
        if _straight_and_level(course):
            return _along(course, times_s)
        turns = self._turns(course)
        t = _with_end(turns, times_s)
        down, level, _ = self._vertical(course, t)
        return _arcs(course, turns, t, down, level)

    def states(self, course: Courses, times_s: Array) -> list[State]:
        """The state of each course after its own time, `times_s` of shape (m,)."""
        table = self._table(course, times_s)
        if course.later is not None:
            later = course.later[times_s[course.later.rows] > course.later.after_s]
            since = times_s[later.rows] - later.after_s
            if len(since):
                table[later.rows] = self._table(self._second(course, later), since)
        return [State(*row) for row in table.tolist()]

    def _table(self, course: Courses, times_s: Array) -> Array:
        """States as rows, as far as nothing else is next: shape (m, 6)."""
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

    def _second(self, course: Courses, later: Later) -> Courses:
        """The courses that some change to, from where they are by then."""
        columns = [getattr(course, name)[later.rows] for name in _COLUMNS]
        start = self._table(Courses(*columns), later.after_s)
        aims = (later.heading_rad, later.climb_mps, later.level_down_m, later.sense)
        return Courses(*[*start.T.copy(), *aims])

    def climb_mps(self, aim: Aim, state: State) -> float:
        """Vertical speed (up positive) to command now: the aim's, or less to level off."""
        course = courses([(state, aim)])
        return float(_climbs(course, self._level_off_s(course))[0])

    def turn_time_s(self, course: Courses) -> Array:
        """How long each turn takes, shape (m,)."""
        return self._turns(course).time_s

    def _turns(self, course: Courses) -> Turns:
        # Into (-pi, pi], as the controller does: half a turn goes to the right.
        left = np.remainder(np.pi - (course.aim_heading_rad - course.heading_rad), math.tau)
        turn = np.pi - left
        if course.sense is not None:
            turn += math.tau * course.sense * (course.sense * turn < 0.0)
        limit = self.limits.turn_rate_radps(1.0) / course.speed_mps
        return Turns(turn, np.abs(turn) / limit, np.sign(turn) * limit)

    def _level_off_s(self, course: Courses) -> Array:
        """Time constant with which each climb levels off: longer where the pull is not flyable."""
        steepest = math.sin(self.limits.flight_path_rad)
        sine = np.minimum(np.abs(course.aim_climb_mps) / course.speed_mps, steepest)
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
    bounded = _clip(wanted, np.abs(course.aim_climb_mps))
    return np.where(np.isnan(wanted), course.aim_climb_mps, bounded)


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
    climb = np.maximum(np.abs(course.flight_path_rad), np.abs(course.aim_climb_mps))
    off = np.abs(course.level_down_m - course.down_m) >= STRAIGHT
    if not climb.max() < STRAIGHT or off.any():
        return False
    turn = course.aim_heading_rad - course.heading_rad
    return bool(np.abs(np.sin(turn)).max() < STRAIGHT and np.cos(turn).min() > 0.0)


def _level(course: Courses) -> bool:
    """Whether nobody climbs, nor is to, not even a little."""
    off = np.abs(course.flight_path_rad) + np.abs(course.aim_climb_mps)
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
