"""One UAV that comes up behind another on nearly the same course."""

from __future__ import annotations

import math
import random

from fleet.config.scenario import NotNegative, Scenario
from fleet.study.encounters.courses import StraightCourse
from fleet.study.encounters.encounter_kind import (
    DrawnEncounter,
    EncounterKind,
    FlightTime,
    Lengths,
    Speeds,
    either_sign,
    uniform,
)


class Overtaking(EncounterKind, frozen=True, tag="overtaking"):
    """kind = "overtaking": the one behind is faster by `faster_mps`, and starts `gap_m` behind.

    It flies `beside_m` beside and `vertical_m` above or below the other, and the two courses
    differ by up to `angle_deg`. Both have the waypoint that they would reach at `until_s`.
    """

    speed_mps: Speeds = (20.0, 30.0)
    faster_mps: tuple[NotNegative, NotNegative] = (2.0, 10.0)
    gap_m: Lengths = (450.0, 700.0)
    beside_m: Lengths = (0.0, 200.0)
    vertical_m: Lengths = (0.0, 20.0)
    angle_deg: NotNegative = 3.0
    altitude_m: Lengths = (400.0, 600.0)
    until_s: FlightTime = 240.0
    duration_s: FlightTime = 300.0

    def drawn(self, dice: random.Random, number: int, scenario: Scenario) -> DrawnEncounter:  # noqa: ARG002
        """Two UAVs; which of them is number 1 is a matter of chance."""
        speed_mps, gap_m = uniform(dice, self.speed_mps), uniform(dice, self.gap_m)
        faster_mps = speed_mps + uniform(dice, self.faster_mps)
        east_m = either_sign(dice, uniform(dice, self.beside_m))
        down_m = -uniform(dice, self.altitude_m)
        above_m = either_sign(dice, uniform(dice, self.vertical_m))
        turn_rad = math.radians(uniform(dice, (-self.angle_deg, self.angle_deg)))
        courses = [
            StraightCourse((0.0, 0.0, down_m), 0.0, speed_mps, 0.0),
            StraightCourse((-gap_m, east_m, down_m - above_m), turn_rad, faster_mps, 0.0),
        ]
        if dice.random() < 0.5:
            courses.reverse()
        uavs = tuple(c.uav(n, self.until_s) for n, c in enumerate(courses, start=1))
        return DrawnEncounter(uavs, None, self.duration_s)
