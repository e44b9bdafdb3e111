"""Where BlueSky's CRECONFS creates an aircraft: so that it is in conflict with another one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fleet.imports.bluesky_text import (
    StackCommand,
    airspeed_mps,
    altitude_m,
    duration_s,
    heading_deg,
    number_of,
)
from fleet.imports.foreign_units import NAUTICAL_MILES_TO_M
from fleet.imports.reckoned_flight import ReckonedFlight


@dataclass(frozen=True, slots=True)
class MeetingPoint:
    """Where an aircraft begins, relative to the altitude of whom it meets."""

    north_m: float
    east_m: float
    above_m: float
    course_rad: float
    speed_mps: float
    climb_mps: float


def meeting_point(
    command: StackCommand, other: ReckonedFlight, height_m: float, separation_m: tuple[float, float]
) -> MeetingPoint:
    """The start of `CRECONFS id,type,target,dpsi,cpa,tlos_hor,[dH,tlos_ver,spd]`.

    As `Traffic.creconfs` reckons it: on a course turned by dpsi from the target's, it loses
    horizontal separation after tlos_hor, and comes as near as cpa. Speeds are those over ground, in
    this frame. Raises ValueError.
    """
    turn, cpa, time = (command.argument(k) for k in (3, 4, 5))
    above, time_up, speed = (command.argument(k) for k in (6, 7, 8))
    required_m, required_up_m = separation_m
    course = other.course_rad + math.radians(heading_deg(turn))
    above_m = altitude_m(above) if above else 0.0
    tlos_s, least_m = duration_s(time), number_of(cpa) * NAUTICAL_MILES_TO_M
    speed_mps = airspeed_mps(speed, height_m + above_m) if speed else other.speed_mps
    north, east = other.velocity_mps()
    closing_n = north - speed_mps * math.cos(course)
    closing_e = east - speed_mps * math.sin(course)
    closing_mps = math.hypot(closing_n, closing_e)
    if closing_mps == 0.0:
        raise ValueError("both fly the same course at the same speed, and never meet")
    inside_m = math.sqrt(max(0.0, required_m**2 - least_m**2))
    way_m = tlos_s * closing_mps + inside_m
    along_n, along_e = closing_n / closing_mps, closing_e / closing_mps
    place_n = other.north_m + way_m * along_n + least_m * along_e
    place_e = other.east_m + way_m * along_e - least_m * along_n
    up_s = duration_s(time_up) if time_up else tlos_s
    climb = max(0.0, abs(above_m) - required_up_m) / up_s if above_m and up_s else 0.0
    return MeetingPoint(place_n, place_e, above_m, course, speed_mps, climb)
