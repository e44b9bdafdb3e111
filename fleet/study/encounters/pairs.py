"""Two UAVs that meet at any angle."""

from __future__ import annotations

import math
import random
from typing import Annotated

from msgspec import Meta

from fleet.config.scenario import LEAST_POSITIVE, ConfigTable, NotNegative, Scenario
from fleet.study.encounters.courses import StraightCourse, beside, start_apart
from fleet.study.encounters.encounter_kind import (
    DRAW_ATTEMPTS,
    DrawnEncounter,
    EncounterKind,
    FlightTime,
    Fraction,
    Lengths,
    Speeds,
    TimeSpan,
    either_sign,
    no_room,
    uniform,
)

CrossingAngle = Annotated[float, Meta(ge=-360.0, le=360.0)]


class Near(ConfigTable, frozen=True):
    """[encounters.near]: this share of the encounters is drawn nearer than these distances."""

    share: Annotated[float, Meta(ge=LEAST_POSITIVE, lt=1.0)]
    miss_m: NotNegative
    vertical_m: NotNegative


class Pairs(EncounterKind, frozen=True, tag="pairs"):
    """kind = "pairs": two straight courses, nearest each other at `cpa_s` without avoidance.

    Crossing angle, both speeds, the time of the closest point of approach, and there the horizontal
    miss distance and the vertical offset are uniform, to either side. Each of the two climbs or
    descends (at `guidance.climb_mps`) with the probability `climbing`. They start at least
    `apart_m` horizontally or `apart_vertical_m` vertically from each other, which leaves out draws.
    The last waypoint comes `beyond_s` after the closest point. With `near` draws are weighted.
    """

    angle_deg: tuple[CrossingAngle, CrossingAngle] = (0.0, 360.0)
    speed_mps: Speeds = (20.0, 40.0)
    cpa_s: TimeSpan = (45.0, 60.0)
    miss_m: Lengths = (0.0, 400.0)
    vertical_m: Lengths = (0.0, 50.0)
    altitude_m: Lengths = (400.0, 600.0)
    climbing: Fraction = 0.3
    beyond_s: FlightTime = 30.0
    duration_s: FlightTime = 120.0
    apart_m: NotNegative = 450.0
    apart_vertical_m: NotNegative = 60.0
    near: Near | None = None

    def problem(self) -> str:
        """Beside spans: a part that is drawn more often has to be one."""
        near = self.near
        if near and not (
            self.miss_m[0] < near.miss_m <= self.miss_m[1]
            and self.vertical_m[0] < near.vertical_m <= self.vertical_m[1]
        ):
            return "near: outside of miss_m and vertical_m"
        return super().problem()

    def drawn(self, dice: random.Random, number: int, scenario: Scenario) -> DrawnEncounter:
        """Two UAVs; which of them is number 1 is a matter of chance."""
        for _ in range(DRAW_ATTEMPTS):
            miss_m, vertical_m, weight = self._miss(dice)
            courses = self._courses(dice, miss_m, vertical_m, scenario.guidance.climb_mps)
            lowest_m = min(-course.where(self.duration_s)[2] for course in courses)
            if lowest_m > 0.0 and start_apart(courses, self.apart_m, self.apart_vertical_m):
                until_s = courses[0].at_s + self.beyond_s
                if dice.random() < 0.5:
                    courses.reverse()
                uavs = tuple(c.uav(n, until_s) for n, c in enumerate(courses, start=1))
                return DrawnEncounter(uavs, None, self.duration_s, weight)
        raise no_room("pairs", number)

    def _courses(
        self, dice: random.Random, miss_m: float, vertical_m: float, climb_mps: float
    ) -> list[StraightCourse]:
        """Two, which are nearest each other horizontally at the same time."""
        heading_rad = dice.random() * math.tau
        angle_rad = math.radians(uniform(dice, self.angle_deg))
        at_s, altitude_m = uniform(dice, self.cpa_s), uniform(dice, self.altitude_m)
        speeds = [uniform(dice, self.speed_mps) for _ in range(2)]
        climbs = [
            either_sign(dice, climb_mps) if dice.random() < self.climbing else 0.0 for _ in range(2)
        ]
        one = StraightCourse((0.0, 0.0, -altitude_m), heading_rad, speeds[0], at_s, climbs[0])
        level_mps = math.sqrt(speeds[1] * speeds[1] - climbs[1] * climbs[1])
        north, east, down = beside(one, heading_rad + angle_rad, level_mps, miss_m)
        place = (north, east, down - vertical_m)
        return [one, StraightCourse(place, heading_rad + angle_rad, speeds[1], at_s, climbs[1])]

    def _miss(self, dice: random.Random) -> tuple[float, float, float]:
        """Miss distance and vertical offset, and the weight of an encounter with these.

        That is the density with which they occur by that with which they are drawn.
        """
        near, miss, vertical = self.near, self.miss_m, self.vertical_m
        if near and dice.random() < near.share:
            miss, vertical = (miss[0], near.miss_m), (vertical[0], near.vertical_m)
        miss_m, vertical_m = uniform(dice, miss), uniform(dice, vertical)
        weight = 1.0
        if near:
            within = miss_m <= near.miss_m and vertical_m <= near.vertical_m
            part = (near.miss_m - self.miss_m[0]) * (near.vertical_m - self.vertical_m[0])
            whole = (self.miss_m[1] - self.miss_m[0]) * (self.vertical_m[1] - self.vertical_m[0])
            weight = 1.0 / (1.0 - near.share + (near.share * whole / part if within else 0.0))
        return either_sign(dice, miss_m), either_sign(dice, vertical_m), weight
