"""The paper's 3-DOF point mass: its flight (eq. 1 to 3) and the mapping M(S, tc, cc, n) of eq. 5.

A course is "turn at the bank limit to a heading, ramp to a climb, hold both"; optionally the climb
ends by levelling off at an altitude, as guidance does. It begins with a change of speed, if its
intent has another one (`fleet.model.vehicle.speed_changes`).

Everything is closed form: psi being linear in time during the turn, the chord over a turned angle
a = psi - psi0 is (sin psi - sin psi0, cos psi0 - cos psi) / a times the level distance flown. That
is exact while the flight path angle is constant, and second order in it while a climb begins or
ends inside the turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from fleet.model.elementary import asin, cos, exp, sin, sincos
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.corridors import Corridor
from fleet.model.vehicle.courses import Courses
from fleet.model.vehicle.few_courses import (
    climb_of,
    commanded_climb,
    course_of,
    few_state,
    few_states,
)
from fleet.model.vehicle.flight import BankLimits, Setpoint, State, fly
from fleet.model.vehicle.intent import STRAIGHT, Intent
from fleet.model.vehicle.model import Performance, VehicleModel
from fleet.model.vehicle.registry import vehicle_model
from fleet.model.vehicle.speed_changes import STEADY_MPS, SpeedChanges, speed_changes

FEW_COURSES = 8
"""The states of so many are predicted faster one by one."""

BEFORE_S = 0.1
"""So long before a change is due it is not counted on being still to come."""

LITTLE_M = 1.0
"""Nobody needs to climb by less."""

PULL_M = 0.1
"""By so much a climb that is predicted from a later state may differ, beside its pull."""


@vehicle_model
class PointMassPerformance(Performance, frozen=True, tag="point_mass"):
    """A point mass that turns by banking."""

    max_bank_deg: Annotated[float, Meta(ge=1e-3, lt=80.0)] = 30.0
    max_flight_path_deg: Annotated[float, Meta(ge=1e-3, lt=60.0)] = 15.0
    max_flight_path_rate_degps: Annotated[float, Meta(ge=1e-3, le=1e6)] = 6.0
    max_acceleration_mps2: Annotated[float, Meta(ge=1e-3, le=1e6)] = 2.0

    def model(self, level_off_s: float) -> PointMass:
        """In SI units and radians."""
        limits = BankLimits(
            acceleration_mps2=self.max_acceleration_mps2,
            bank_rad=math.radians(self.max_bank_deg),
            flight_path_rad=math.radians(self.max_flight_path_deg),
            flight_path_rate_radps=math.radians(self.max_flight_path_rate_degps),
        )
        return PointMass(limits, level_off_s)


@dataclass(frozen=True, slots=True)
class Turns:
    """The turns that m courses begin with, arrays of shape (m,): right positive."""

    angle_rad: Array
    time_s: Array
    rate_radps: Array


@dataclass(frozen=True, slots=True)
class PointMass(VehicleModel):
    """Flown by `fleet.model.vehicle.flight.fly`, and predicted in closed form."""

    limits: BankLimits

    def step(self, state: State, setpoint: Setpoint, dt_s: float) -> State:
        """Fly for one tick or less."""
        return fly(state, setpoint, self.limits, dt_s)

    def states(self, course: Courses, times_s: Array) -> list[State]:
        """One by one where they are few, and nothing changes within their times."""
        if len(course) <= FEW_COURSES and course.sense is None and course.intent_speed_mps is None:
            due = self._due(course)
            if due is None or not (times_s[due.rows] > due.after_s).any():
                return few_states(course, times_s.tolist(), self.limits, self.level_off_s)
        return VehicleModel.states(self, course, times_s)

    def after(self, state: State, intent: Intent, time_s: float) -> State:
        """The same for one without arrays, if nothing changes within the time."""
        then, speeds = intent.then, [intent.speed_mps]
        if then is not None and intent.bends:
            speeds += [then.speed_mps]
            if time_s > then.after_s:
                return VehicleModel.after(self, state, intent, time_s)
        if any(abs(speed - state.speed_mps) > STEADY_MPS for speed in speeds):
            return VehicleModel.after(self, state, intent, time_s)
        return few_state(course_of(state, intent), time_s, self.limits, self.level_off_s)

    def places(self, course: Courses, times_s: Array) -> Array:
        """Positions alone: most of what is asked, and cheaper than states."""
        out = self._steady_places(course, times_s)
        change = speed_changes(
            course.speed_mps, course.intent_speed_mps, self.limits.acceleration_mps2
        )
        if change is not None:
            times = np.broadcast_to(times_s, out.shape[:2])[change.rows]
            ends = change.time_s[:, None]
            during = self._changing(course, change, np.minimum(times, ends))[..., :3]
            after = self._steady_places(
                self._changed(course, change), np.maximum(times - ends, 0.0)
            )
            out[change.rows] = np.where((times > ends)[..., None], after, during)
        return out

    def _steady_places(self, course: Courses, times_s: Array) -> Array:
        """Positions at the speeds of the start."""
        bent = self._by_all_formulae(course)
        if len(bent) == len(course):
            turns = self._turns(course)
            t = _with_end(turns, times_s)
            down, level, _ = self._vertical(course, t)
            return _arcs(course, turns, t, down, level)
        out = _along(course, times_s)
        if len(bent):
            out[bent] = self._steady_places(course.rows(bent), _of(times_s, bent))
        return out

    def predict(self, course: Courses, times_s: Array) -> Array:
        """States, in closed form."""
        table = self._steady(course, times_s)
        change = speed_changes(
            course.speed_mps, course.intent_speed_mps, self.limits.acceleration_mps2
        )
        if change is not None:
            times = np.broadcast_to(times_s, table.shape[:2])[change.rows]
            ends = change.time_s[:, None]
            during = self._changing(course, change, np.minimum(times, ends))
            after = self._steady(self._changed(course, change), np.maximum(times - ends, 0.0))
            table[change.rows] = np.where((times > ends)[..., None], after, during)
        return table

    def _changing(self, course: Courses, change: SpeedChanges, t: Array) -> Array:
        """States (k, n, 6) of those that change their speed, at times t (k, n) until they have.

        Climbs are flown as at the mean of both speeds.
        """
        part, mean = course.rows(change.rows), 0.5 * (change.from_mps + change.to_mps)
        turn = self._turns(part).angle_rad
        way = change.way(part.heading_rad, turn, self.limits.grip_mps2, t)
        path = asin(_clip(part.speed_mps * sin(part.flight_path_rad) / mean, 1.0))
        down, level, climb = self._vertical(replace(part, speed_mps=mean, flight_path_rad=path), t)
        flat = np.where(t > 0.0, level / np.where(t > 0.0, mean[:, None] * t, 1.0), 1.0)
        columns = (
            part.north_m[:, None] + flat * way.north_m,
            part.east_m[:, None] + flat * way.east_m,
            down,
            way.speed_mps,
            _wrapped(way.heading_rad),
            asin(_clip(climb / way.speed_mps, 1.0)),
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
        done = np.abs(_wrapped(part.intent_heading_rad - after.heading_rad)) < STRAIGHT
        return replace(after, sense=np.where(done, 0.0, part.sense))

    def _steady(self, course: Courses, times_s: Array) -> Array:
        """States (m, n, 6) at the speeds of the start."""
        bent = self._by_all_formulae(course)
        if len(bent) == len(course):
            return self._bent(course, times_s)
        out = np.zeros((len(course), np.shape(times_s)[-1], 6))
        out[..., :3] = _along(course, times_s)
        out[..., 3], out[..., 4] = course.speed_mps[:, None], _wrapped(course.heading_rad)[:, None]
        if len(bent):
            out[bent] = self._bent(course.rows(bent), _of(times_s, bent))
        return out

    def _bent(self, course: Courses, times_s: Array) -> Array:
        """The same by the formulae for those who turn or climb, which hold for all."""
        turns = self._turns(course)
        t = _with_end(turns, times_s)
        down, level, climb = self._vertical(course, t)
        out = np.empty((len(t), t.shape[1] - 1, 6))
        out[..., :3] = _arcs(course, turns, t, down, level)
        turned = turns.rate_radps[:, None] * np.minimum(t[:, :-1], turns.time_s[:, None])
        heading = course.heading_rad[:, None] + turned
        out[..., 3] = course.speed_mps[:, None]
        out[..., 4] = _wrapped(heading)
        out[..., 5] = asin(_clip(climb[:, :-1] / course.speed_mps[:, None], 1.0))
        return out

    def _by_all_formulae(self, course: Courses) -> NDArray[np.intp]:
        """The rows of those who turn or climb; of all, where they are few and somebody does."""
        straight = self._straight_on(course)
        if len(course) <= FEW_COURSES and not straight.all():
            return np.arange(len(course))
        return np.flatnonzero(~straight)

    def _straight_on(self, course: Courses) -> NDArray[np.bool_]:
        """Who neither turns nor climbs, but for rounding: as nearly everybody, shape (m,)."""
        straight: NDArray[np.bool_] = _level(course) & (np.abs(course.turns_rad()) < STRAIGHT)
        return straight

    def straight(self, course: Courses) -> NDArray[np.bool_]:
        """Those that keep heading, altitude and speed."""
        straight = self._straight_on(course)
        told = course.intent_speed_mps
        if told is not None:
            straight &= ~(np.abs(told - course.speed_mps) > STEADY_MPS)
        return straight

    def corridor(
        self,
        state: State,
        intent: Intent,
        age_s: float,
        horizon_s: float,
        *,
        otherwise_s: float = 0.0,
    ) -> Corridor | None:
        """Along the heading of the intent; None where the speed changes, or a change is due.

        Nor is one known of who is at another altitude than it levels off at, and does not climb.

        Turning through an angle a at the rate w, a UAV strays from a line along the heading at the
        end of the turn by V a^2 / 2w at most, and by V (1 - cos) of the path angle for each second
        in which it climbs.
        """
        speed, then, until_s = state.speed_mps, intent.then, math.inf
        off_m = abs(intent.level_down_m - state.down_m)
        if abs(intent.speed_mps - speed) > STEADY_MPS or (
            off_m > LITTLE_M and abs(intent.climb_mps) < STRAIGHT
        ):
            return None
        if then is not None and intent.bends:
            until_s = then.after_s - age_s - BEFORE_S
            if until_s < 0.0 or abs(then.speed_mps - speed) > STEADY_MPS:
                return None
        turn = abs(wrap_angle(intent.heading_rad - state.heading_rad))
        turn += otherwise_s * self.limits.turn_rate_radps(speed)
        stray = speed * (
            otherwise_s * turn + 0.5 * turn * turn / self.limits.turn_rate_radps(speed)
        )
        low = high = state.down_m
        if otherwise_s > 0.0 or not _keeps_level(state, intent):
            span_s = age_s + horizon_s
            stray += speed * span_s * (1.0 - cos(self._steepest_rad(state)))
            low, high = self._levels(state, intent, span_s, otherwise_s)
        sine, cosine = sincos(intent.heading_rad)
        to_north, to_east = speed * cosine, speed * sine
        return Corridor(
            state.north_m + age_s * to_north,
            state.east_m + age_s * to_east,
            to_north,
            to_east,
            stray,
            low,
            high,
            speed,
            until_s,
        )

    def _steepest_rad(self, state: State) -> float:
        return max(abs(state.flight_path_rad), self.limits.flight_path_rad)

    def _levels(
        self, state: State, intent: Intent, span_s: float, otherwise_s: float
    ) -> tuple[float, float]:
        """Between which down stays; beyond its start and end by what a pull takes at most."""
        speed, rate, steepest = (
            state.speed_mps,
            self.limits.flight_path_rate_radps,
            self._steepest_rad(state),
        )
        if otherwise_s > 0.0:
            path = max(abs(state.flight_path_rad), 1.1 * abs(intent.climb_mps) / speed)
            path = min(steepest, path + otherwise_s * rate)
            beyond = speed * (path * path / rate + otherwise_s * steepest) + 1.0
        else:
            climb = climb_of(course_of(state, intent), self.limits, self.level_off_s)
            beyond = speed * (abs(climb.from_sine) + abs(climb.sine)) * climb.ramp_s + PULL_M
        to = intent.level_down_m
        if math.isnan(to):
            to = state.down_m - intent.climb_mps * span_s
        return min(state.down_m, to) - beyond, max(state.down_m, to) + beyond

    def climb_mps(self, intent: Intent, state: State) -> float:
        """The same for one without arrays."""
        return commanded_climb(course_of(state, intent), self.limits, self.level_off_s)[0] + 0.0

    def turn_time_s(self, course: Courses) -> Array:
        """How long each turn takes, for all at once."""
        return self._turns(course).time_s

    def _turns(self, course: Courses) -> Turns:
        turn = course.turns_rad()
        turn = np.where(np.abs(turn) < STRAIGHT, 0.0, turn)
        limit = self.limits.turn_rate_radps(1.0) / course.speed_mps
        return Turns(turn, np.abs(turn) / limit, np.sign(turn) * limit)

    def levelling_s(self, course: Courses) -> Array:
        """Time constant with which each climb levels off, for all at once."""
        steepest = sin(self.limits.flight_path_rad)
        sine = np.minimum(np.abs(course.intent_climb_mps) / course.speed_mps, steepest)
        return np.maximum(self.level_off_s, sine / self.limits.flight_path_rate_radps)

    def _ramp(self, course: Courses, level_off_s: Array) -> tuple[Array, Array, Array]:
        """Final path angle, signed rate and time of the ramp to the commanded climb."""
        sine = _clip(course.climbs_mps(level_off_s) / course.speed_mps, 1.0)
        final = _clip(asin(sine), self.limits.flight_path_rad)
        change = final - course.flight_path_rad
        rate = np.where(change < 0, -1.0, 1.0) * self.limits.flight_path_rate_radps
        return final, rate, change / rate

    def _vertical(self, course: Courses, t: Array) -> tuple[Array, Array, Array]:
        """Down, level distance flown and climb rate at times t (m, n)."""
        climbing = np.flatnonzero(~_level(course))
        if len(climbing) == len(course):
            return self._climbed(course, t)
        down, level = course.down_m[:, None] + np.zeros_like(t), course.speed_mps[:, None] * t
        climb = np.zeros_like(t)
        if len(climbing):
            parts = self._climbed(course.rows(climbing), t[climbing])
            down[climbing], level[climbing], climb[climbing] = parts
        return down, level, climb

    def _climbed(self, course: Courses, t: Array) -> tuple[Array, Array, Array]:
        """The same of those that climb or dive: ramp, climb, capture."""
        level_off_s = self.levelling_s(course)
        final, rate, ramp_time = self._ramp(course, level_off_s)
        (sine0, cosine0), (sine, cosine) = sincos(course.flight_path_rad), sincos(final)
        radius = course.speed_mps / rate
        up, level = (radius * (cosine0 - cosine))[:, None], (radius * (sine - sine0))[:, None]
        speed, sine, cosine = course.speed_mps[:, None], sine[:, None], cosine[:, None]
        climb = speed * sine
        since = np.maximum(t - ramp_time[:, None], 0.0)
        if np.isnan(course.level_down_m).all():
            up, level = up + climb * since, level + speed * cosine * since
            rate_of_climb = np.repeat(climb, t.shape[1], axis=1)
        else:
            tau = level_off_s[:, None]
            left = (course.down_m - course.level_down_m)[:, None] - up
            steady_time, remaining = _capture(left, climb, tau)
            steady, decay = np.minimum(since, steady_time), np.maximum(since - steady_time, 0.0)
            left = exp(-decay / tau)
            up = up + climb * steady + remaining * (1.0 - left)
            # the level speed lost to a decaying climb w exp(-t/tau) is w^2/(2V) exp(-2t/tau)
            start = remaining / tau
            lost = start * start * tau / (4.0 * speed) * (1.0 - left * left)
            level = level + speed * cosine * steady + speed * decay - lost
            rate_of_climb = np.where(decay > 0.0, start * left, climb)
        row, column = np.nonzero(t < ramp_time[:, None])
        if len(row):
            at, radius = (row, column), radius[row]
            sine, cosine = sincos(course.flight_path_rad[row] + rate[row] * t[at])
            up[at], level[at] = radius * (cosine0[row] - cosine), radius * (sine - sine0[row])
            rate_of_climb[at] = course.speed_mps[row] * sine
        return course.down_m[:, None] - up, level, rate_of_climb


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


def _wrapped(angle_rad: Array) -> Array:
    """The same directions in [-pi, pi)."""
    return np.remainder(angle_rad + np.pi, math.tau) - np.pi


def _keeps_level(state: State, intent: Intent) -> bool:
    """Whether a UAV does not climb, not even a little."""
    off = abs(intent.level_down_m - state.down_m) > 0.0
    return state.flight_path_rad == 0.0 and intent.climb_mps == 0.0 and not off


def _level(course: Courses) -> NDArray[np.bool_]:
    """Who does not climb, nor is to, but for rounding, shape (m,)."""
    climb = np.maximum(np.abs(course.flight_path_rad), np.abs(course.intent_climb_mps))
    off = np.abs(course.level_down_m - course.down_m) >= STRAIGHT
    level: NDArray[np.bool_] = (climb < STRAIGHT) & ~off
    return level


def _of(times_s: Array, rows: NDArray[np.intp]) -> Array:
    """The times of some courses."""
    return times_s if times_s.ndim == 1 else times_s[rows]


def _with_end(turns: Turns, times_s: Array) -> Array:
    """Times, shape (n,) or (m, n), and after them the end of each turn: shape (m, n + 1)."""
    count = np.shape(times_s)[-1]
    t = np.empty((len(turns.time_s), count + 1))
    t[:, :count] = times_s
    t[:, count] = turns.time_s
    return t


def _arcs(course: Courses, turns: Turns, t: Array, down: Array, level: Array) -> Array:
    """Positions at times t but the last, the end of the turn, given down and level distance."""
    ahead, (sine, cosine) = sincos(course.heading_rad), sincos(course.heading_rad + turns.angle_rad)
    north, east = _chords(ahead, 0.5 * turns.angle_rad, level[:, -1])
    after = level[:, :-1] - level[:, -1:]
    out = np.empty((*after.shape, 3))
    out[..., 0] = (course.north_m + north)[:, None] + after * cosine[:, None]
    out[..., 1] = (course.east_m + east)[:, None] + after * sine[:, None]
    out[..., 2] = down[:, :-1]
    row, column = np.nonzero(t[:, :-1] < turns.time_s[:, None])
    if len(row):
        at, (sine, cosine) = (row, column), ahead
        half = 0.5 * turns.rate_radps[row] * t[at]
        north, east = _chords((sine[row], cosine[row]), half, level[at])
        out[*at, 0], out[*at, 1] = course.north_m[row] + north, course.east_m[row] + east
    return out


def _chords(ahead: tuple[Array, Array], half_rad: Array, arc_m: Array) -> tuple[Array, Array]:
    """North and east flown in arcs: chords sin(a/2)/(a/2) as long, along the mean headings.

    `ahead` are sine and cosine of the headings at the start, `half_rad` is a/2.
    """
    (sine0, cosine0), (sine, cosine) = ahead, sincos(half_rad)
    turning = half_rad != 0.0
    chord = arc_m * np.where(turning, sine / np.where(turning, half_rad, 1.0), 1.0)
    return chord * (cosine0 * cosine - sine0 * sine), chord * (sine0 * cosine + cosine0 * sine)


def _along(course: Courses, times_s: Array) -> Array:
    """Positions on straight and level courses: `_arcs` of no turn, bit by bit."""
    way, (sine, cosine) = course.speed_mps[:, None] * times_s, sincos(course.heading_rad + 0.0)
    out = np.empty((*way.shape, 3))
    out[..., 0] = course.north_m[:, None] + way * cosine[:, None]
    out[..., 1] = course.east_m[:, None] + way * sine[:, None]
    out[..., 2] = course.down_m[:, None]
    out += 0.0
    return out
