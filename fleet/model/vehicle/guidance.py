"""Guidance: flies the waypoints in order and says what it commands.

The way to a waypoint is "turn at the limit, then straight on" (see `tangent`). The commanded
heading is that of the straight part, so that it does not move while the turn lasts; the commanded
climb regains the waypoint's altitude.

After the last waypoint the UAV flies on for ever along the line of the last leg: towards points on
it, of which the next one is taken when the UAV has come near abeam.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec import Struct

from fleet.model.elementary import asin, atan2, cos, exp, sincos
from fleet.model.units import to_s, wrap_angle
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.intent import STRAIGHT, Intent, NextCourse
from fleet.model.vehicle.limits import Limits
from fleet.model.vehicle.model import VehicleModel
from fleet.model.vehicle.speed_changes import STEADY_MPS, time_to_fly_s
from fleet.model.vehicle.tangent import TangentPath, tangent_path

Waypoint = tuple[float, float, float]

GUIDANCE_STEP_NS = 200_000_000
"""Guidance steers at least so often, however long a tick is."""

WITHIN = 0.9
"""A turn meant to pass within this part of the arrival radius arrives, in spite of rounding."""

LEADS = 4
"""Distance of the points on the last leg's line, in units of how near they are left behind."""

FAR_S = 1e6
"""What takes longer is not told more exactly."""


@dataclass(frozen=True, slots=True)
class GuidanceSettings:
    """How the plan is flown."""

    speed_mps: float
    climb_mps: float
    level_off_s: float
    arrival_radius_m: float


class FlightPlan(Struct, frozen=True, gc=False):
    """The waypoints, the course of the last leg, which is flown on for ever, and what is active."""

    waypoints: tuple[Waypoint, ...]
    course_rad: float
    active: int = 0

    @property
    def arrived(self) -> bool:
        """Whether every waypoint has been reached."""
        return self.active >= len(self.waypoints)

    @property
    def waypoint(self) -> Waypoint:
        """The active waypoint, or the last one after arrival."""
        return self.waypoints[min(self.active, len(self.waypoints) - 1)]


def last_course(points: Sequence[Waypoint], heading_rad: float) -> float:
    """Course of the last leg between points that has a length; the heading where none has."""
    for k in range(len(points) - 1, 0, -1):
        (north, east, _), (to_north, to_east, _) = points[k - 1], points[k]
        if (north, east) != (to_north, to_east):
            return _course(to_north - north + 0.0, to_east - east + 0.0)
    return heading_rad


@lru_cache(maxsize=4096)
def _course(north_m: float, east_m: float) -> float:
    """Everybody asks for it of everybody. No zero is negative: a cache takes both for one."""
    return atan2(east_m, north_m)


class WayToGoal(NamedTuple):
    """Where guidance flies from a state: its goal and the way to it."""

    goal: Waypoint
    way: TangentPath


@dataclass(frozen=True, slots=True)
class Pilot:
    """Guidance of one UAV: how it flies its plan, within its limits."""

    settings: GuidanceSettings
    model: VehicleModel

    @property
    def limits(self) -> Limits:
        """What the UAV can do at most."""
        return self.model.limits

    def advance(self, plan: FlightPlan, before: State, after: State) -> FlightPlan:
        """The plan with every waypoint ticked off that was reached between two states.

        A waypoint is reached where the chord comes within the arrival radius, horizontally, not
        before the one that precedes it.
        """
        since, radius_m = 0.0, self.settings.arrival_radius_m
        while plan.active < len(plan.waypoints):
            reached = _reached(plan.waypoints[plan.active], before, after, radius_m, since)
            if reached is None:
                return plan
            plan, since = FlightPlan(plan.waypoints, plan.course_rad, plan.active + 1), reached
        return plan

    def to_goal(self, plan: FlightPlan, state: State) -> WayToGoal:
        """What `guide` and `intent` go by."""
        goal = self.goal(plan, state)
        return WayToGoal(goal, self._way(state, goal))

    def guide(self, plan: FlightPlan, state: State, to_goal: WayToGoal | None = None) -> Setpoint:
        """Speed, heading and climb towards where the plan leads."""
        goal, way = to_goal or self.to_goal(plan, state)
        settings = self.settings
        climb = climb_to(goal[2], state.down_m, settings)
        return Setpoint(wrap_angle(state.heading_rad + way.first_rad), climb, settings.speed_mps)

    def intent(
        self,
        plan: FlightPlan,
        state: State,
        to_goal: WayToGoal | None = None,
        ahead: FlightPlan | None = None,
    ) -> Intent:
        """The same as prediction takes it: what is commanded now, and what is next, and when.

        Next is the rest of a turn that goes on or back, or else the way to the next waypoint, from
        where the active one is reached; beyond that nothing is foreseen. What is known already, as
        `to_goal` and `ahead` give it, need not be found again.
        """
        goal, way = to_goal or self.to_goal(plan, state)
        after = (ahead or self.ahead(plan, state, goal)).waypoints[1]
        heading = wrap_angle(state.heading_rad + way.first_rad)
        climb = climb_to(goal[2], state.down_m, self.settings)
        then = self._then(state, way, goal, self._stop_m(plan, heading), after)
        return Intent(heading, climb, goal[2], then, then.speed_mps)

    def intents(self, plan: FlightPlan, states: Iterable[State]) -> Iterator[Intent]:
        """The aims at successive states of one flight, of which some may have passed waypoints."""
        before = None
        for state in states:
            plan = self.advance(plan, before or state, state)
            yield self.intent(plan, state)
            before = state

    def goal(self, plan: FlightPlan, state: State) -> Waypoint:
        """Where to fly: the active waypoint, or a point on the line of the last leg.

        The points on the line are always the same, and each is outside the turning circles of a UAV
        that flies to it.
        """
        if plan.active < len(plan.waypoints):
            return plan.waypoints[plan.active]
        north, east, _ = plan.waypoint
        ahead_east, ahead_north = sincos(plan.course_rad)
        along = (state.north_m - north) * ahead_north + (state.east_m - east) * ahead_east
        count = math.floor((along + self.lead_m) / self.spacing_m) + 1
        return self._on_line(plan.waypoint, plan.course_rad, count)

    def ahead(self, plan: FlightPlan, state: State, goal: Waypoint | None = None) -> FlightPlan:
        """Of the plan what there is to know for a while: where it leads now, and then.

        After the last waypoint, and beyond it, these are points on the line of the last leg.
        """
        goal, course = goal or self.goal(plan, state), plan.course_rad
        if plan.active + 1 < len(plan.waypoints):
            after = plan.waypoints[plan.active + 1]
        else:
            after = self._on_line(goal, course, 1)
        points = (goal, after)
        return FlightPlan(points, last_course(points, course), len(points) if plan.arrived else 0)

    def follow(
        self, plan: FlightPlan, state: State, span_ns: int
    ) -> tuple[FlightPlan, list[State]]:
        """The plan after a time in which guidance flies, and the states after each of its steps."""
        if span_ns <= GUIDANCE_STEP_NS:
            plan, after = self._step(plan, state, self.guide(plan, state), to_s(span_ns))
            return plan, [after]
        states = [state]
        for dt_s in _steps_s(span_ns):
            told = self.guide(plan, states[-1])
            plan, after = self._step(plan, states[-1], told, dt_s)
            states.append(after)
        return plan, states[1:]

    def hold(
        self, plan: FlightPlan, state: State, told: Setpoint, span_ns: int
    ) -> tuple[FlightPlan, State]:
        """Plan and state after a time in which a command is held."""
        if span_ns <= GUIDANCE_STEP_NS:
            return self._step(plan, state, told, to_s(span_ns))
        for dt_s in _steps_s(span_ns):
            plan, state = self._step(plan, state, told, dt_s)
        return plan, state

    def _way(self, state: State, goal: Waypoint) -> TangentPath:
        radius = self.limits.turn_radius_m(state.speed_mps)
        return tangent_path(state, goal, radius, WITHIN * self.settings.arrival_radius_m)

    def _stop_m(self, plan: FlightPlan, heading_rad: float) -> float:
        """How far before its goal a UAV on this heading turns to the next."""
        if not plan.arrived:
            return self.settings.arrival_radius_m
        return self.lead_m / max(0.1, cos(heading_rad - plan.course_rad))

    def _then(
        self, state: State, way: TangentPath, goal: Waypoint, stop_m: float, after: Waypoint
    ) -> NextCourse:
        """What is next on a way to a goal, of which the last `stop_m` are not flown."""
        radius = self.limits.turn_radius_m(state.speed_mps)
        turned = way.turned_rad(radius, stop_m)
        straight = max(0.0, way.straight_m - stop_m) if not way.twofold else 0.0
        way_m = radius * turned + straight
        cruising, later_s, speed_mps = self._regaining(state, way_m)
        time_s, down = climbing(cruising, goal[2], way_m, self.settings, self.limits)
        time_s += later_s
        there = way.state_at(cruising, radius, turned, straight, down)
        goal = goal if way.twofold else after
        turn = self._way(there, goal).turn_rad
        heading = wrap_angle(there.heading_rad + turn)
        climb = climb_to(goal[2], down, self.settings)
        return NextCourse(min(time_s, FAR_S), heading, climb, goal[2], turn, speed_mps)

    def _regaining(self, state: State, way_m: float) -> tuple[State, float, float]:
        """The state at cruise speed, how much later than at that a way is flown, and that speed.

        NaN stands for a speed that is cruise speed already.
        """
        cruise = self.settings.speed_mps
        if abs(state.speed_mps - cruise) <= STEADY_MPS:
            return state, 0.0, math.nan
        at = np.array([state.speed_mps]), np.array([cruise])
        took_s = time_to_fly_s(*at, self.limits.acceleration_mps2, np.array([way_m]))
        cruising = msgspec.structs.replace(state, speed_mps=cruise)
        return cruising, float(took_s[0]) - way_m / cruise, cruise

    def _step(
        self, plan: FlightPlan, state: State, told: Setpoint, dt_s: float
    ) -> tuple[FlightPlan, State]:
        after = self.model.step(state, told, dt_s)
        return self.advance(plan, state, after), after

    @property
    def lead_m(self) -> float:
        """How far before a point on the line of the last leg the next one is flown to."""
        settings = self.settings
        return max(settings.arrival_radius_m, 2.0 * self.limits.turn_radius_m(settings.speed_mps))

    @property
    def spacing_m(self) -> float:
        """How far these points are apart."""
        return LEADS * self.lead_m

    def _on_line(self, point: Waypoint, course_rad: float, count: int) -> Waypoint:
        """So many points further on a line."""
        distance = count * self.spacing_m
        (north, east, down), (sine, cosine) = point, sincos(course_rad)
        return (north + distance * cosine, east + distance * sine, down)


def _steps_s(span_ns: int) -> list[float]:
    """A span in steps of at most `STEP_NS`."""
    whole, rest = divmod(span_ns, GUIDANCE_STEP_NS)
    return [to_s(GUIDANCE_STEP_NS)] * whole + ([to_s(rest)] if rest else [])


def _reached(
    waypoint: Waypoint, before: State, after: State, radius_m: float, since: float
) -> float | None:
    """The fraction of the chord, `since` or later, at which a waypoint is reached; None if not."""
    north, east, _ = waypoint
    end_north, end_east = after.north_m - north, after.east_m - east
    step_north, step_east = after.north_m - before.north_m, after.east_m - before.east_m
    reach = radius_m + abs(step_north) + abs(step_east)
    if end_north * end_north + end_east * end_east > reach * reach:
        return None
    from_north = before.north_m + since * step_north - north
    from_east = before.east_m + since * step_east - east
    c = from_north * from_north + from_east * from_east - radius_m * radius_m
    if c <= 0.0:
        return since
    a = step_north * step_north + step_east * step_east
    b = from_north * step_north + from_east * step_east
    if a > 0.0 and b < 0.0 and b * b >= a * c:
        fraction = since + (-b - math.sqrt(b * b - a * c)) / a
        if fraction <= 1.0:
            return fraction
    return 1.0 if end_north * end_north + end_east * end_east <= radius_m * radius_m else None


def climb_to(target_down_m: float, down_m: float, settings: GuidanceSettings) -> float:
    """Vertical speed (up positive) that closes an altitude error, levelling off exponentially."""
    wanted = (down_m - target_down_m) / settings.level_off_s
    return max(-settings.climb_mps, min(settings.climb_mps, wanted))


def climbing(
    state: State, down_m: float, way_m: float, settings: GuidanceSettings, limits: Limits
) -> tuple[float, float]:
    """How long a horizontal way takes while guidance climbs to an altitude, and the down then.

    A climb w takes w^2 / 2V of the level speed; the ramp to it counts as half its time's delay.
    """
    time_s, speed = way_m / state.speed_mps, state.speed_mps
    height = state.down_m - down_m
    climb = abs(climb_to(down_m, state.down_m, settings))
    if climb < STRAIGHT:
        return time_s, state.down_m
    final = asin(min(1.0, climb / speed)) * math.copysign(1.0, height)
    delay = 0.5 * abs(final - state.flight_path_rad) / limits.pitch_rate_radps(speed)
    rising = max(0.0, time_s - delay)
    capture = climb * settings.level_off_s
    steady = min(rising, (abs(height) - capture) / climb)
    left = exp((steady - rising) / settings.level_off_s)
    decaying = 0.5 * settings.level_off_s * (1.0 - left * left)
    lost = climb * climb / (2.0 * speed) * (steady + decaying)
    risen = climb * steady + capture * (1.0 - left)
    return time_s + lost / speed, state.down_m - math.copysign(risen, height)
