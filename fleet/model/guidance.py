"""Guidance: flies the waypoints in order and says what it commands.

The way to a waypoint is the shorter of two: turn right, or left, at the limit, then straight on. A
waypoint beside the UAV and inside its turning circle is thus reached by a turn to the other side.
The commanded heading is that of the straight part, so that it does not move while the turn lasts;
the commanded climb regains the waypoint's altitude.

After the last waypoint the UAV flies on for ever along the line of the last leg: towards points on
it, of which the next one is taken when the UAV has come near abeam.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from msgspec import Struct

from fleet.model.flight import Command, Limits, State, fly
from fleet.model.trajectory import Aim
from fleet.model.units import to_s, wrap_angle

Waypoint = tuple[float, float, float]

STEP_NS = 200_000_000
"""Guidance steers at least so often, however long a tick is."""

WITHIN = 0.9
"""A turn meant to pass within this part of the arrival radius arrives, in spite of rounding."""

LEADS = 4
"""Distance of the points on the last leg's line, in units of how near they are left behind."""

ON_COURSE_RAD = 1e-3
"""So little to the wrong side is rounding, and not a full circle short of it."""


@dataclass(frozen=True, slots=True)
class GuidanceSettings:
    """How the plan is flown."""

    speed_mps: float
    climb_mps: float
    level_off_s: float
    arrival_radius_m: float


class Plan(Struct, frozen=True, gc=False):
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
    for (north, east, _), (to_north, to_east, _) in reversed(list(pairwise(points))):
        if (north, east) != (to_north, to_east):
            return math.atan2(to_east - east, to_north - north)
    return heading_rad


@dataclass(frozen=True, slots=True)
class Pilot:
    """Guidance of one UAV: how it flies its plan, within its limits."""

    settings: GuidanceSettings
    limits: Limits

    def advance(self, plan: Plan, before: State, after: State) -> Plan:
        """The plan with every waypoint ticked off that was reached between two states.

        A waypoint is reached where the chord comes within the arrival radius, horizontally, not
        before the one that precedes it.
        """
        since = 0.0
        while not plan.arrived:
            reached = _reached(plan.waypoint, before, after, self.settings.arrival_radius_m, since)
            if reached is None:
                return plan
            plan, since = Plan(plan.waypoints, plan.course_rad, plan.active + 1), reached
        return plan

    def guide(self, plan: Plan, state: State) -> Command:
        """Speed, heading and climb towards where the plan leads."""
        goal, settings = self.goal(plan, state), self.settings
        radius = self.limits.turn_radius_m(state.speed_mps)
        turn = turn_to(state, goal, radius, WITHIN * settings.arrival_radius_m)
        heading = wrap_angle(state.heading_rad + first_turn(turn))
        climb = climb_to(goal[2], state.down_m, settings)
        return Command(heading, climb, settings.speed_mps)

    def aim(self, plan: Plan, state: State) -> Aim:
        """The same as prediction takes it."""
        wanted = self.guide(plan, state)
        return Aim(wanted.heading_rad, wanted.climb_mps, plan.waypoint[2])

    def goal(self, plan: Plan, state: State) -> Waypoint:
        """Where to fly: the active waypoint, or a point on the line of the last leg.

        The points on the line are always the same, and each is outside the turning circles of a UAV
        that flies to it.
        """
        if not plan.arrived:
            return plan.waypoint
        north, east, _ = plan.waypoint
        ahead_north, ahead_east = math.cos(plan.course_rad), math.sin(plan.course_rad)
        along = (state.north_m - north) * ahead_north + (state.east_m - east) * ahead_east
        count = math.floor((along + self.lead_m) / self.spacing_m) + 1
        return self._on_line(plan.waypoint, plan.course_rad, count)

    def ahead(self, plan: Plan, state: State) -> Plan:
        """Of the plan what there is to know for a while: where it leads now, and then.

        After the last waypoint, and beyond it, these are points on the line of the last leg.
        """
        goal, course = self.goal(plan, state), plan.course_rad
        if plan.active + 1 < len(plan.waypoints):
            after = plan.waypoints[plan.active + 1]
        else:
            after = self._on_line(goal, course, 1)
        points = (goal, after)
        return Plan(points, last_course(points, course), len(points) if plan.arrived else 0)

    def follow(self, plan: Plan, state: State, span_ns: int) -> tuple[Plan, list[State]]:
        """The plan after a time in which guidance flies, and the states after each of its steps."""
        states = [state]
        for dt_s in _steps_s(span_ns):
            told = self.guide(plan, states[-1])
            plan, after = self._step(plan, states[-1], told, dt_s)
            states.append(after)
        return plan, states[1:]

    def hold(self, plan: Plan, state: State, told: Command, span_ns: int) -> tuple[Plan, State]:
        """Plan and state after a time in which a command is held."""
        for dt_s in _steps_s(span_ns):
            plan, state = self._step(plan, state, told, dt_s)
        return plan, state

    def _step(self, plan: Plan, state: State, told: Command, dt_s: float) -> tuple[Plan, State]:
        after = fly(state, told, self.limits, dt_s)
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
        north, east, down = point
        return (
            north + distance * math.cos(course_rad),
            east + distance * math.sin(course_rad),
            down,
        )


def _steps_s(span_ns: int) -> list[float]:
    """A span in steps of at most `STEP_NS`."""
    whole, rest = divmod(span_ns, STEP_NS)
    return [to_s(STEP_NS)] * whole + ([to_s(rest)] if rest else [])


def _reached(
    waypoint: Waypoint, before: State, after: State, radius_m: float, since: float
) -> float | None:
    """The fraction of the chord, `since` or later, at which a waypoint is reached; None if not."""
    north, east, _ = waypoint
    end_m = math.hypot(after.north_m - north, after.east_m - east)
    step_north, step_east = after.north_m - before.north_m, after.east_m - before.east_m
    if end_m > radius_m + math.hypot(step_north, step_east):
        return None
    from_north = before.north_m + since * step_north - north
    from_east = before.east_m + since * step_east - east
    if math.hypot(from_north, from_east) <= radius_m:
        return since
    a = step_north**2 + step_east**2
    b = from_north * step_north + from_east * step_east
    c = from_north**2 + from_east**2 - radius_m**2
    if a > 0.0 and b < 0.0 and b * b >= a * c:
        fraction = since + (-b - math.sqrt(b * b - a * c)) / a
        if fraction <= 1.0:
            return fraction
    return 1.0 if end_m <= radius_m else None


def climb_to(target_down_m: float, down_m: float, settings: GuidanceSettings) -> float:
    """Vertical speed (up positive) that closes an altitude error, levelling off exponentially."""
    wanted = (down_m - target_down_m) / settings.level_off_s
    return max(-settings.climb_mps, min(settings.climb_mps, wanted))


def turn_to(state: State, goal: Sequence[float], radius_m: float, within_m: float) -> float:
    """The turn, right positive, within a full circle, after which the goal is dead ahead.

    It goes to the goal's side, unless the goal is inside the turning circle there by more than
    `within_m`: then to the other. Of a goal on the circle, or inside by less, it is the turn which
    comes nearest to it.
    """
    to_north, to_east = goal[0] - state.north_m, goal[1] - state.east_m
    ahead_north, ahead_east = math.cos(state.heading_rad), math.sin(state.heading_rad)
    forward = to_north * ahead_north + to_east * ahead_east
    right = to_east * ahead_north - to_north * ahead_east
    side = 1.0 if right >= 0.0 else -1.0
    if math.hypot(forward, abs(right) - radius_m) < radius_m - within_m:
        side = -side
    # As seen from the centre of the circle, the UAV being to its left (mirrored for a left turn).
    aside = side * right - radius_m
    tangent = math.sqrt(max(0.0, forward**2 + aside**2 - radius_m**2))
    turn = math.atan2(aside, forward) + math.atan2(radius_m, tangent)
    if turn < -ON_COURSE_RAD:
        turn += math.tau
    return side * turn


def first_turn(turn_rad: float) -> float:
    """A turn as the controller is told it, which turns the shorter way: half of one of more."""
    return 0.5 * turn_rad if abs(turn_rad) > math.pi else turn_rad
