"""States of a few point masses on their courses: what `PointMass.predict` has for many, one by one.

A few take less time so than as arrays. The bits are the same: the same formulae in the same order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fleet.model.elementary import asin, exp, sin, sincos
from fleet.model.vehicle.courses import Courses
from fleet.model.vehicle.flight import BankLimits, State
from fleet.model.vehicle.intent import STRAIGHT, Intent


class Course(NamedTuple):
    """A row of `Courses`."""

    north_m: float
    east_m: float
    down_m: float
    speed_mps: float
    heading_rad: float
    flight_path_rad: float
    intent_heading_rad: float
    intent_climb_mps: float
    level_down_m: float


class Climb(NamedTuple):
    """How a course climbs: from path angle to path angle at a rate, and on until it levels off."""

    path_rad: float
    from_sine: float
    from_cosine: float
    sine: float
    cosine: float
    rate_radps: float
    ramp_s: float
    level_off_s: float


def few_states(
    courses: Courses, times_s: list[float], limits: BankLimits, level_off_s: float
) -> list[State]:
    """The state on each course after its own time, while it is flown at the speed of its start."""
    rows = [
        Course(*row)
        for row in zip(
            courses.north_m.tolist(),
            courses.east_m.tolist(),
            courses.down_m.tolist(),
            courses.speed_mps.tolist(),
            courses.heading_rad.tolist(),
            courses.flight_path_rad.tolist(),
            courses.intent_heading_rad.tolist(),
            courses.intent_climb_mps.tolist(),
            courses.level_down_m.tolist(),
            strict=True,
        )
    ]
    return [few_state(row, t, limits, level_off_s) for row, t in zip(rows, times_s, strict=True)]


def few_state(row: Course, time_s: float, limits: BankLimits, level_off_s: float) -> State:
    """The state on one of them."""
    climb = None if _level(row) else climb_of(row, limits, level_off_s)
    return _state(row, time_s, climb, limits.grip_mps2)


def _state(row: Course, t: float, climb: Climb | None, grip_mps2: float) -> State:
    turn = math.pi - (math.pi - (row.intent_heading_rad - row.heading_rad)) % math.tau
    if abs(turn) < STRAIGHT:
        turn = 0.0
    limit = grip_mps2 / row.speed_mps
    turn_s, rate = abs(turn) / limit, limit * ((turn > 0.0) - (turn < 0.0))
    down, way, climb_mps = _vertical(row, climb, t)
    ahead = sincos(row.heading_rad)
    if turn == 0.0:
        north, east = row.north_m + way * ahead[1], row.east_m + way * ahead[0]
    elif t < turn_s:
        north, east = _chord(ahead, 0.5 * rate * t, way)
        north, east = row.north_m + north, row.east_m + east
    else:
        end_way = _vertical(row, climb, turn_s)[1]
        north, east = _chord(ahead, 0.5 * turn, end_way)
        sine, cosine = sincos(row.heading_rad + turn)
        after = way - end_way
        north, east = (row.north_m + north) + after * cosine, (row.east_m + east) + after * sine
    heading = row.heading_rad + rate * min(t, turn_s)
    return State(
        north + 0.0,
        east + 0.0,
        down + 0.0,
        row.speed_mps + 0.0,
        (heading + math.pi) % math.tau - math.pi + 0.0,
        asin(_within(climb_mps / row.speed_mps, 1.0)) + 0.0,
    )


def _chord(ahead: tuple[float, float], half_rad: float, arc_m: float) -> tuple[float, float]:
    """North and east flown in an arc, as `point_mass` has it."""
    (sine0, cosine0), (sine, cosine) = ahead, sincos(half_rad)
    chord = arc_m * (sine / half_rad if half_rad != 0.0 else 1.0)
    return chord * (cosine0 * cosine - sine0 * sine), chord * (sine0 * cosine + cosine0 * sine)


def course_of(state: State, intent: Intent) -> Course:
    """A course as long as what is next is not due, nor the speed changes."""
    return Course(
        state.north_m,
        state.east_m,
        state.down_m,
        state.speed_mps,
        state.heading_rad,
        state.flight_path_rad,
        intent.heading_rad,
        intent.climb_mps,
        intent.level_down_m,
    )


def commanded_climb(row: Course, limits: BankLimits, level_off_s: float) -> tuple[float, float]:
    """The climb commanded at its start, and the time constant with which it levels off."""
    speed, most, steepest = row.speed_mps, abs(row.intent_climb_mps), sin(limits.flight_path_rad)
    tau = max(level_off_s, min(most / speed, steepest) / limits.flight_path_rate_radps)
    wanted = (row.down_m - row.level_down_m) / tau
    return row.intent_climb_mps if math.isnan(wanted) else _within(wanted, most), tau


def climb_of(row: Course, limits: BankLimits, level_off_s: float) -> Climb:
    """How it climbs."""
    climb, tau = commanded_climb(row, limits, level_off_s)
    path, speed = row.flight_path_rad, row.speed_mps
    final = _within(asin(_within(climb / speed, 1.0)), limits.flight_path_rad)
    change = final - path
    rate = (-1.0 if change < 0.0 else 1.0) * limits.flight_path_rate_radps
    return Climb(path, *sincos(path), *sincos(final), rate, change / rate, tau)


def _vertical(row: Course, climb: Climb | None, t: float) -> tuple[float, float, float]:
    """Down, level distance flown and climb rate: ramp, climb, capture."""
    speed = row.speed_mps
    if climb is None:
        return row.down_m + 0.0, speed * t, 0.0
    path, sine0, cosine0, sine, cosine, rate, ramp_s, tau = climb
    radius = speed / rate
    if t < ramp_s:
        sine, cosine = sincos(path + rate * t)
        return row.down_m - radius * (cosine0 - cosine), radius * (sine - sine0), speed * sine
    up, level = radius * (cosine0 - cosine), radius * (sine - sine0)
    climb_mps, since = speed * sine, max(t - ramp_s, 0.0)
    if math.isnan(row.level_down_m):
        return (
            row.down_m - (up + climb_mps * since),
            level + speed * cosine * since,
            climb_mps,
        )
    steady_s, remaining = _capture((row.down_m - row.level_down_m) - up, climb_mps, tau)
    steady, decay = min(since, steady_s), max(since - steady_s, 0.0)
    left = exp(-decay / tau)
    up = up + climb_mps * steady + remaining * (1.0 - left)
    start = remaining / tau
    lost = start * start * tau / (4.0 * speed) * (1.0 - left * left)
    level = level + speed * cosine * steady + speed * decay - lost
    return row.down_m - up, level, start * left if decay > 0.0 else climb_mps


def _capture(height_m: float, climb_mps: float, tau: float) -> tuple[float, float]:
    """Time in the steady climb before levelling off, and the height left at that moment."""
    if math.isnan(height_m):
        return math.inf, 0.0
    steady_up = height_m - climb_mps * tau
    if steady_up * climb_mps > 0.0 and abs(climb_mps) > STRAIGHT:
        return steady_up / climb_mps, climb_mps * tau
    return 0.0, height_m


def _within(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


def _level(row: Course) -> bool:
    """Whether a UAV does not climb, nor is to, but for rounding."""
    climb = max(abs(row.flight_path_rad), abs(row.intent_climb_mps))
    return climb < STRAIGHT and not abs(row.level_down_m - row.down_m) >= STRAIGHT
