"""The flight of each UAV as planned: what it flies when nobody commands it, and how far from it.

That path is flown here again, by the same guidance and flight model as in the run, so that corners
are cut and altitudes regained as they always are, and only what avoidance and faults did is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fleet.analysis.relative_motion import Bools
from fleet.config.scenario import Scenario, Uav
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan

STRAIGHT_RAD = 1e-7
"""A path that bends by less since the last corner has no new one."""
BEYOND_M = 1e5
LEAD = 2000
"""So many ticks at least beyond what is on record an undisturbed flight is flown."""
PLANNED_BLOCK = 32
"""Places that are compared with the path at a time: few, so that they are near each other."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """So near to its planned path and altitude a UAV is on its plan."""

    path_m: float = 25.0
    altitude_m: float = 5.0

    def off(self, path_m: Array, altitude_m: Array) -> Bools:
        """Whether deviations are more than that."""
        more: Bools = (path_m > self.path_m) | (altitude_m > self.altitude_m)
        return more


@dataclass(frozen=True)
class Planned:
    """An undisturbed flight over so many ticks, if not for ever.

    The corners (n, 3) of its path, which goes on far beyond, and when it has reached its last
    waypoint, by the first tick after it; None if it has not by then.
    """

    corners: Array
    arrival_ns: int | None
    ticks: float


class Plans:
    """The undisturbed flights of a fleet, each flown when it is first asked for.

    A scenario can be of a day in milliseconds, and little of it be on record. So a flight is flown
    on only as more comes on record, and over twice as many ticks each time.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._flown: dict[int, Planned] = {}

    def of(self, uav: Uav, recorded: int) -> Planned:
        """That of a UAV of the fleet, of which so many ticks are on record."""
        ticks = 2 * LEAD
        while ticks < recorded + LEAD:
            ticks *= 2
        known = self._flown.get(uav.id)
        if known is None or known.ticks < min(ticks, self._scenario.ticks):
            known = self._flown[uav.id] = planned_flight(uav, self._scenario, ticks)
        return known


def planned_flight(uav: Uav, scenario: Scenario, ticks: int | None = None) -> Planned:
    """What a UAV flies if nobody commands it and nothing befalls it, in so many ticks at most.

    Without `ticks` to the end of the scenario.
    """
    pilot, state = scenario.pilot(uav.id, uav.speed_mps), uav.state()
    plan = pilot.advance(uav.plan(), state, state)
    corners, direction = [state.position_ned_m], state
    arrival_ns = 0 if plan.arrived else None
    left = scenario.ticks
    last: float = min(left, ticks or left)
    for tick in range(1, int(last) + 1):
        if plan.arrived and _settled(plan, direction, state):
            last = math.inf
            break
        left -= 1
        plan, states = pilot.follow(plan, state, scenario.tick_ns)
        for before, after in pairwise([state, *states]):
            if _bends(direction, after):
                if before.position_ned_m != corners[-1]:
                    corners.append(before.position_ned_m)
                corners.append(after.position_ned_m)
                direction = after
        state = states[-1]
        if arrival_ns is None and plan.arrived:
            arrival_ns = tick * scenario.tick_ns
    north, east, down = state.position_ned_m
    beyond_m = BEYOND_M + left * scenario.tick_s * state.speed_mps
    along = beyond_m * np.array([np.cos(state.heading_rad), np.sin(state.heading_rad)])
    corners += [state.position_ned_m, (north + along[0], east + along[1], down)]
    return Planned(np.array(corners), arrival_ns, last)


def _settled(plan: FlightPlan, direction: State, state: State) -> bool:
    """Whether a flight is on its last course, and level: so it goes on for ever.

    It has been so since the last corner, or guidance would have turned it: on this course, but
    beside the line of the last leg, it would not stay.
    """
    away = max(
        abs(wrap_angle(s.heading_rad - plan.course_rad)) + abs(s.flight_path_rad)
        for s in (direction, state)
    )
    return away < STRAIGHT_RAD


def _bends(since: State, now: State) -> bool:
    turned = wrap_angle(now.heading_rad - since.heading_rad)
    pitched = now.flight_path_rad - since.flight_path_rad
    return max(abs(turned), abs(pitched)) > STRAIGHT_RAD


def deviations(corners: Array, places: Array) -> tuple[Array, Array]:
    """Horizontal distance of places (n, 3) from a path, and that of altitudes at its nearest point.

    `corners` (m, 3) are joined by straight lines.
    """
    parts = [
        _deviations(corners, places[n : n + PLANNED_BLOCK])
        for n in range(0, len(places), PLANNED_BLOCK)
    ]
    path_m, altitude_m = zip(*parts, strict=True)
    return np.concatenate(path_m), np.concatenate(altitude_m)


def _deviations(corners: Array, places: Array) -> tuple[Array, Array]:
    start, step = _near(corners[:-1], np.diff(corners, axis=0), places)
    fraction, distance = _to_lines(start, step, places)
    rows, nearest = np.arange(len(places)), np.argmin(distance, axis=1)
    planned_down = start[nearest, 2] + fraction[rows, nearest] * step[nearest, 2]
    return distance[rows, nearest], np.abs(places[:, 2] - planned_down)


def _near(start: Array, step: Array, places: Array) -> tuple[Array, Array]:
    """Without the lines that are farther from all the places than one line is from any of them.

    Lines and places are compared by the boxes round them, so that a long flight with many turns
    does not take every place times every corner.
    """
    ends = np.stack([start[:, :2], start[:, :2] + step[:, :2]])
    gaps = np.maximum(ends.min(axis=0) - places[:, :2].max(axis=0), 0.0)
    gaps = np.maximum(gaps, places[:, :2].min(axis=0) - ends.max(axis=0))
    least = np.hypot(gaps[:, 0], gaps[:, 1])
    one = [int(np.argmin(least))]
    farthest = _to_lines(start[one], step[one], places)[1].max()
    farthest = max(farthest, least.min())  # of one place both are the same, but for rounding
    return start[least <= farthest], step[least <= farthest]


def _to_lines(start: Array, step: Array, places: Array) -> tuple[Array, Array]:
    """Where on each line each place is nearest, as a fraction of it, and how far it is there."""
    length = np.maximum(np.sum(step[:, :2] ** 2, axis=1), 1e-12)
    away = places[:, None, :2] - start[:, :2]
    fraction = np.clip(np.sum(away * step[:, :2], axis=2) / length, 0.0, 1.0)
    beside = away - fraction[:, :, None] * step[:, :2]
    return fraction, np.hypot(beside[..., 0], beside[..., 1])
