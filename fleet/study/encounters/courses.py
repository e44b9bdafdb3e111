"""Straight courses through a place at a time, from which encounters are made."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fleet.config.scenario import Point, Uav
from fleet.model.elementary import hypot, sincos


@dataclass(frozen=True)
class StraightCourse:
    """A straight flight that is at `place_ned_m` at time `at_s`, seen from the start.

    `climb_mps` is upwards, and is flown from the start to the last waypoint.
    """

    place_ned_m: Point
    heading_rad: float
    speed_mps: float
    at_s: float
    climb_mps: float = 0.0

    def where(self, t_s: float) -> Point:
        """Where it is at a time."""
        east, north = sincos(self.heading_rad)
        along_m = self.level_mps * (t_s - self.at_s)
        down_m = -self.climb_mps * (t_s - self.at_s)
        at = self.place_ned_m
        return at[0] + along_m * north, at[1] + along_m * east, at[2] + down_m

    @property
    def level_mps(self) -> float:
        """Its speed over the ground."""
        return math.sqrt(self.speed_mps * self.speed_mps - self.climb_mps * self.climb_mps)

    def uav(self, number: int, until_s: float) -> Uav:
        """The UAV that flies it, to a waypoint that it reaches at `until_s`."""
        start, goal = self.where(0.0), self.where(until_s)
        heading_deg = round(math.degrees(math.remainder(self.heading_rad, math.tau)), 6)
        return Uav(number, start, heading_deg, (goal,), self.speed_mps, climb_mps=self.climb_mps)


def beside(one: StraightCourse, two_heading_rad: float, two_mps: float, miss_m: float) -> Point:
    """Where another is when `one` is at its place, if they are nearest then, and so far apart.

    Horizontally, on the right of the relative velocity for a positive miss distance. Two on the
    same course at the same speed are always nearest.
    """
    (sine, cosine), (other_sine, other_cosine) = sincos(one.heading_rad), sincos(two_heading_rad)
    north = two_mps * other_cosine - one.level_mps * cosine
    east = two_mps * other_sine - one.level_mps * sine
    closing = hypot(north, east)
    if closing == 0.0:
        north, east, closing = cosine, sine, 1.0
    at = one.place_ned_m
    return at[0] - miss_m * east / closing, at[1] + miss_m * north / closing, at[2]


def start_apart(courses: Sequence[StraightCourse], apart_m: float, apart_vertical_m: float) -> bool:
    """Whether the last of them starts with room to all before it."""
    *others, last = (course.where(0.0) for course in courses)
    return all(
        hypot(last[0] - other[0], last[1] - other[1]) >= apart_m
        or abs(last[2] - other[2]) >= apart_vertical_m
        for other in others
    )
