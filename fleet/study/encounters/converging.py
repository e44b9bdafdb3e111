"""Several UAVs that meet near one place at about one time."""

from __future__ import annotations

import math
import random
from typing import Annotated

from msgspec import Meta

from fleet.config.scenario import NotNegative, Scenario
from fleet.study.encounters.courses import StraightCourse, start_apart
from fleet.study.encounters.encounter_kind import (
    DRAW_ATTEMPTS,
    DrawnEncounter,
    EncounterKind,
    FlightTime,
    Lengths,
    Speeds,
    TimeSpan,
    no_room,
    uniform,
)

FleetSize = Annotated[int, Meta(ge=2, le=200)]


class Converging(EncounterKind, frozen=True, tag="converging"):
    """kind = "converging": `count` UAVs of any heading, each through a place near the origin.

    The place is within `spread_m` north and east of it and `vertical_m` in altitude, and they are
    there at `meet_s`, each for itself. All start apart, and have their last waypoint `beyond_s`
    after that.
    """

    count: tuple[FleetSize, FleetSize] = (4, 4)
    speed_mps: Speeds = (20.0, 30.0)
    meet_s: TimeSpan = (60.0, 70.0)
    spread_m: NotNegative = 200.0
    vertical_m: NotNegative = 25.0
    altitude_m: Lengths = (400.0, 600.0)
    beyond_s: FlightTime = 60.0
    duration_s: FlightTime = 240.0
    apart_m: NotNegative = 500.0
    apart_vertical_m: NotNegative = 60.0

    def drawn(self, dice: random.Random, number: int, scenario: Scenario) -> DrawnEncounter:  # noqa: ARG002
        """One UAV after the other, each drawn until it has room."""
        count = self.count[0] + int(dice.random() * (self.count[1] - self.count[0] + 1))
        altitude_m, courses = uniform(dice, self.altitude_m), list[StraightCourse]()
        for _ in range(DRAW_ATTEMPTS):
            courses.append(self._course(dice, altitude_m))
            if not start_apart(courses, self.apart_m, self.apart_vertical_m):
                courses.pop()
            elif len(courses) == count:
                uavs = tuple(
                    c.uav(n, c.at_s + self.beyond_s) for n, c in enumerate(courses, start=1)
                )
                return DrawnEncounter(uavs, None, self.duration_s)
        raise no_room("converging", number)

    def _course(self, dice: random.Random, altitude_m: float) -> StraightCourse:
        spread, vertical = (-self.spread_m, self.spread_m), (-self.vertical_m, self.vertical_m)
        north, east, up = uniform(dice, spread), uniform(dice, spread), uniform(dice, vertical)
        heading_rad, speed_mps = dice.random() * math.tau, uniform(dice, self.speed_mps)
        at_s = uniform(dice, self.meet_s)
        return StraightCourse((north, east, -altitude_m - up), heading_rad, speed_mps, at_s)
