"""Predicted trajectories: the mapping M(S, tc, cc, n) of eq. 5, for many UAVs and options at once.

A course is "turn at the bank limit to a heading, ramp to a climb, hold both"; optionally the climb
ends by levelling off at an altitude, as guidance does and `Predictor.climb_mps` says. Everything is
closed form: psi being linear in time during the turn, the chord over a turned angle a = psi - psi0
is (sin psi - sin psi0, cos psi0 - cos psi) / a times the level distance flown. That is exact while
the flight path angle is constant, and second order in it while a climb begins or ends inside the
turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from fleet.model.flight import Limits, State

Array = NDArray[np.float64]


class Aim(Struct, frozen=True, gc=False):
    """Heading and climb to fly; `level_down_m` is where the climb levels off (NaN: it does not).

    With a level the climb only says how fast to go there at most, from above or from below.
    """

    heading_rad: float
    climb_mps: float
    level_down_m: float = math.nan


STRAIGHT = 1e-7
"""Angles (rad), climbs (m/s) and altitude errors (m) below this bend no trajectory."""


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
    """m courses as arrays of shape (m,): where each starts and what it aims at."""

    north_m: Array
    east_m: Array
    down_m: Array
    speed_mps: Array
    heading_rad: Array
    flight_path_rad: Array
    aim_heading_rad: Array
    aim_climb_mps: Array
    level_down_m: Array

    def __len__(self) -> int:
        """Number of courses."""
        return len(self.north_m)


def courses(pairs: Iterable[tuple[State, Aim]]) -> Courses:
    """One course for each (state, aim)."""
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
    return Courses(*table.T.copy())


@dataclass(frozen=True, slots=True)
class Predictor:
    """The mapping M for one airframe; `level_off_s` is guidance's time constant at an altitude."""

    limits: Limits
    level_off_s: float

    def positions(self, course: Courses, times_s: Array) -> Array:
        """NED positions, shape (m, n, 3), at times of shape (n,) or (m, n), from each start."""
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
        t = times_s[:, None]
        position = self.positions(course, t)[:, 0]
        climb = self._vertical(course, t)[2][:, 0]
        _, turn_time, rate = self._turn(course)
        heading = course.heading_rad + rate * np.minimum(times_s, turn_time)
        heading = np.remainder(heading + np.pi, math.tau) - np.pi
        path = np.arcsin(np.clip(climb / course.speed_mps, -1.0, 1.0))
        rows = np.column_stack([position, course.speed_mps, heading, path]).tolist()
        return [State(*row) for row in rows]

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
