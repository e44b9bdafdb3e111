"""Guidance: flies the waypoints in order and says what it commands.

The commanded heading is that of the straight line which leaves the present turning circle towards
the active waypoint, so that "turn at the limit, then straight on" is what will really be flown and
the command does not move while the turn lasts. The commanded climb regains the waypoint's altitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from msgspec import Struct

from fleet.model.flight import Command, Limits, State
from fleet.model.units import wrap_angle

Waypoint = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GuidanceSettings:
    """How the plan is flown."""

    speed_mps: float
    climb_mps: float
    level_off_s: float
    arrival_radius_m: float


class Plan(Struct, frozen=True, gc=False):
    """The waypoints, which of them is active, and the heading to hold after the last one."""

    waypoints: tuple[Waypoint, ...]
    active: int = 0
    final_heading_rad: float = 0.0

    @property
    def arrived(self) -> bool:
        """Whether every waypoint has been reached."""
        return self.active >= len(self.waypoints)

    @property
    def waypoint(self) -> Waypoint:
        """The active waypoint, or the last one after arrival."""
        return self.waypoints[min(self.active, len(self.waypoints) - 1)]


def advance(plan: Plan, state: State, settings: GuidanceSettings) -> Plan:
    """The plan with every waypoint ticked off that `state` has reached (horizontally)."""
    while not plan.arrived:
        north, east, _ = plan.waypoint
        distance = math.hypot(north - state.north_m, east - state.east_m)
        if distance > settings.arrival_radius_m:
            return plan
        plan = Plan(plan.waypoints, plan.active + 1, state.heading_rad)
    return plan


def guide(plan: Plan, state: State, settings: GuidanceSettings, limits: Limits) -> Command:
    """Speed, heading and climb towards the active waypoint; straight and level after the last."""
    climb = climb_to(plan.waypoint[2], state.down_m, settings)
    if plan.arrived:
        return Command(plan.final_heading_rad, climb, settings.speed_mps)
    radius = limits.turn_radius_m(state.speed_mps)
    heading = tangent_heading(state, plan.waypoint, radius)
    return Command(heading, climb, settings.speed_mps)


def climb_to(target_down_m: float, down_m: float, settings: GuidanceSettings) -> float:
    """Vertical speed (up positive) that closes an altitude error, levelling off exponentially."""
    wanted = (down_m - target_down_m) / settings.level_off_s
    return max(-settings.climb_mps, min(settings.climb_mps, wanted))


def tangent_heading(state: State, waypoint: Sequence[float], radius_m: float) -> float:
    """Heading of the tangent from the turning circle on the waypoint's side to the waypoint.

    Inside that circle there is none: the present heading is held until the waypoint is outside.
    """
    to_north, to_east = waypoint[0] - state.north_m, waypoint[1] - state.east_m
    off_nose = wrap_angle(math.atan2(to_east, to_north) - state.heading_rad)
    side = 1.0 if off_nose >= 0.0 else -1.0
    centre_north = -side * radius_m * math.sin(state.heading_rad)
    centre_east = side * radius_m * math.cos(state.heading_rad)
    from_north, from_east = to_north - centre_north, to_east - centre_east
    square = from_north**2 + from_east**2 - radius_m**2
    if square <= 0.0:
        return state.heading_rad
    bearing = math.atan2(from_east, from_north)
    heading = wrap_angle(bearing + side * math.atan2(radius_m, math.sqrt(square)))
    turn = side * wrap_angle(heading - state.heading_rad)
    # More than half a turn to go: keep the controller on this side (less is rounding, on course).
    if turn < -1e-3:
        return wrap_angle(state.heading_rad + side * 0.9 * math.pi)
    return heading
