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

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from fleet.model.flight import Limits, State

Array = NDArray[np.float64]


STRAIGHT = 1e-7
"""Angles (rad), climbs (m/s) and altitude errors (m) below this bend no trajectory."""

BEND_RAD = 1e-4
"""A planned change of heading below this is not worth predicting: 0.2 m in 2 km."""


class Then(Struct, frozen=True, gc=False):
    """What an aim is replaced by after a time.

    The turn to the heading goes the shorter way, unless `turn_rad` (right positive) says that it is
    more than half a circle.
    """

    after_s: float
    heading_rad: float
    climb_mps: float
    level_down_m: float = math.nan
    turn_rad: float = 0.0

    @property
    def sense(self) -> float:
        """Of a turn of more than half a circle: 1 to the right, -1 to the left; else 0."""
        return math.copysign(1.0, self.turn_rad) if abs(self.turn_rad) > math.pi else 0.0


class Aim(Struct, frozen=True, gc=False):
    """Heading and climb to fly; `level_down_m` is where the climb levels off (NaN: it does not).

    With a level the climb only says how fast to go there at most, from above or from below. After a
    time something else may be next.
    """

    heading_rad: float
    climb_mps: float
    level_down_m: float = math.nan
    then: Then | None = None

    def after(self, time_s: float) -> Aim:
        """The same aim as seen so much later."""
        then = self.then
        if then is None:
            return self
        if time_s >= then.after_s:
            # of a long turn only half: the sense would be lost
            heading = then.heading_rad - (0.5 * then.turn_rad if then.sense else 0.0)
            return Aim(heading, then.climb_mps, then.level_down_m)
        left = msgspec.structs.replace(then, after_s=then.after_s - time_s)
        return msgspec.structs.replace(self, then=left)

    @property
    def bends(self) -> bool:
        """Whether what is next is another course."""
        then = self.then
        if then is None:
            return False
        turned = math.remainder(then.heading_rad - self.heading_rad, math.tau)
        levels = abs(then.level_down_m - self.level_down_m) > STRAIGHT
        return abs(turned) > BEND_RAD or then.sense != 0.0 or levels


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
class Altitudes:
    """Between which altitudes (down) an escape stays, or where it begins if that is beyond."""

    floor_down_m: float
    ceiling_down_m: float

    def level_m(self, climb_mps: float, level_down_m: float, start_down_m: float) -> float:
        """Where a climb may level off that is meant to do so at a level (NaN: nowhere).

        It may begin beyond the limits; NaN if it is not known where.
        """
        known = not math.isnan(start_down_m)
        lowest = max(self.floor_down_m, start_down_m) if known else self.floor_down_m
        highest = min(self.ceiling_down_m, start_down_m) if known else self.ceiling_down_m
        if math.isnan(level_down_m):
            level_down_m = highest if climb_mps > 0.0 else lowest
        return max(highest, min(lowest, level_down_m))


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
        count = np.shape(times_s)[-1]
        turn, turn_time, rate = self._turn(course)
        t = np.empty((len(course), count + 1))
        t[:, :count] = times_s
        t[:, count] = turn_time
        down, level, _ = self._vertical(course, t)
        in_arc = np.minimum(level[:, :count], level[:, count:])
        after = level[:, :count] - in_arc
        # chord of an arc by the half angle: sin(a/2)/(a/2) along the mean heading
        half = 0.5 * rate[:, None] * np.minimum(t[:, :count], turn_time[:, None])
        chord = in_arc * np.sinc(half / np.pi)
        mean = course.heading_rad[:, None] + half
        final = (course.heading_rad + turn)[:, None]
        out = np.empty((len(course), count, 3))
        out[..., 0] = course.north_m[:, None] + chord * np.cos(mean) + after * np.cos(final)
        out[..., 1] = course.east_m[:, None] + chord * np.sin(mean) + after * np.sin(final)
        out[..., 2] = down[:, :count]
        return out

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
        t = times_s[:, None]
        position = self._first(course, t)[:, 0]
        climb = self._vertical(course, t)[2][:, 0]
        _, turn_time, rate = self._turn(course)
        heading = course.heading_rad + rate * np.minimum(times_s, turn_time)
        heading = np.remainder(heading + np.pi, math.tau) - np.pi
        path = np.arcsin(np.clip(climb / course.speed_mps, -1.0, 1.0))
        return np.column_stack([position, course.speed_mps, heading, path])

    def _second(self, course: Courses, later: Later) -> Courses:
        """The courses that some change to, from where they are by then."""
        columns = [getattr(course, f.name)[later.rows] for f in fields(Courses)[:9]]
        start = self._table(Courses(*columns), later.after_s)
        aims = (later.heading_rad, later.climb_mps, later.level_down_m, later.sense)
        return Courses(*np.stack([*start.T, *aims]))

    def climb_mps(self, aim: Aim, state: State) -> float:
        """Vertical speed (up positive) to command now: the aim's, or less to level off."""
        return float(self._climb(courses([(state, aim)]))[0])

    def turn_time_s(self, course: Courses) -> Array:
        """How long each turn takes, shape (m,)."""
        return self._turn(course)[1]

    def _turn(self, course: Courses) -> tuple[Array, Array, Array]:
        # Into (-pi, pi], as the controller does: half a turn goes to the right.
        left = np.remainder(np.pi - (course.aim_heading_rad - course.heading_rad), math.tau)
        turn = np.pi - left
        if course.sense is not None:
            turn += math.tau * course.sense * (course.sense * turn < 0.0)
        limit = self.limits.turn_rate_radps(1.0) / course.speed_mps
        return turn, np.abs(turn) / limit, np.sign(turn) * limit

    def _level_off_s(self, course: Courses) -> Array:
        """Time constant with which each climb levels off: longer where the pull is not flyable."""
        steepest = math.sin(self.limits.flight_path_rad)
        sine = np.minimum(np.abs(course.aim_climb_mps) / course.speed_mps, steepest)
        return np.maximum(self.level_off_s, sine / self.limits.flight_path_rate_radps)

    def _climb(self, course: Courses) -> Array:
        """The vertical speed commanded at the start, shape (m,)."""
        most = np.abs(course.aim_climb_mps)
        wanted = (course.down_m - course.level_down_m) / self._level_off_s(course)
        return np.where(np.isnan(wanted), course.aim_climb_mps, np.clip(wanted, -most, most))

    def _ramp(self, course: Courses) -> tuple[Array, Array, Array]:
        """Final path angle, signed rate and time of the ramp to the commanded climb."""
        sine = np.clip(self._climb(course) / course.speed_mps, -1.0, 1.0)
        bound = self.limits.flight_path_rad
        final = np.clip(np.arcsin(sine), -bound, bound)
        change = final - course.flight_path_rad
        rate = np.where(change < 0, -1.0, 1.0) * self.limits.flight_path_rate_radps
        return final, rate, change / rate

    def _vertical(self, course: Courses, t: Array) -> tuple[Array, Array, Array]:
        """Down, level distance flown and climb rate at times t (m, n): ramp, climb, capture."""
        final, rate, ramp_time = (x[:, None] for x in self._ramp(course))
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
        steady_time, remaining = self._capture(course, climb, ramp_up)
        steady = np.minimum(t - ramp, steady_time)
        decay = np.maximum(t - ramp_time - steady_time, 0.0)
        tau = self._level_off_s(course)[:, None]
        left = np.exp(-decay / tau)
        up += climb * steady + remaining * (1.0 - left)
        # the level speed lost to a decaying climb w exp(-t/tau) is w^2/(2V) exp(-2t/tau)
        start = remaining / tau
        lost = start**2 * tau / (4.0 * speed) * (1.0 - left**2)
        level += speed * np.cos(final) * steady + speed * decay - lost
        captured = np.where(decay > 0.0, start * left, speed * sine)
        return course.down_m[:, None] - up, level, captured

    def _capture(self, course: Courses, climb: Array, ramp_up: Array) -> tuple[Array, Array]:
        """Time in the steady climb before levelling off, and the height left at that moment."""
        left = (course.down_m - course.level_down_m)[:, None] - ramp_up
        endless = np.isnan(left)
        left = np.where(endless, 0.0, left)
        tau = self._level_off_s(course)[:, None]
        steady_up = left - climb * tau
        moving = (steady_up * climb > 0.0) & (np.abs(climb) > STRAIGHT)
        steady = np.where(moving, steady_up / np.where(moving, climb, 1.0), 0.0)
        remaining = np.where(moving, climb * tau, left)
        return np.where(endless, np.inf, steady), np.where(endless, 0.0, remaining)


def _straight_and_level(course: Courses) -> bool:
    """Whether nobody turns or climbs, as most of the time: not worth the general formulae."""
    off_altitude = np.nan_to_num(course.level_down_m - course.down_m)
    bends = (
        np.sin(course.aim_heading_rad - course.heading_rad),
        course.flight_path_rad,
        course.aim_climb_mps,
        off_altitude,
    )
    ahead = np.cos(course.aim_heading_rad - course.heading_rad)
    return bool(np.abs(bends).max() < STRAIGHT and ahead.min() > 0.0)


def _along(course: Courses, times_s: Array) -> Array:
    """Positions on straight and level courses."""
    way = course.speed_mps[:, None] * times_s
    out = np.empty((*way.shape, 3))
    out[..., 0] = course.north_m[:, None] + way * np.cos(course.heading_rad)[:, None]
    out[..., 1] = course.east_m[:, None] + way * np.sin(course.heading_rad)[:, None]
    out[..., 2] = course.down_m[:, None]
    return out


def turn_commands(maximum_rad: float, count: int) -> Array:
    """TC: `count` (odd) heading changes, equally spaced over [-maximum, maximum], 0 among them."""
    half = count // 2
    return np.asarray(maximum_rad * (np.arange(-half, half + 1) / half), dtype=np.float64)


def climb_commands(max_dive_mps: float, max_climb_mps: float, count: int) -> Array:
    """CC: `count` (odd) vertical speeds over [-max_dive, max_climb], the middle one zero.

    Equally spaced as in the paper when both bounds are alike, else equally spaced on each side.
    """
    side = count // 2 + 1
    down = np.linspace(-max_dive_mps, 0.0, side)
    return np.concatenate([down, np.linspace(0.0, max_climb_mps, side)[1:]])


def command_set(turns: Array, climbs: Array) -> list[tuple[float, float]]:
    """The (tc, cc) of TJ, eq. 7: every turn with no climb, then every climb with no turn.

    N_T + N_C - 1 of them: the straight one is in both families and listed once.
    """
    pairs = [(float(tc), 0.0) for tc in turns]
    return pairs + [(0.0, float(cc)) for cc in climbs if cc != 0.0]
