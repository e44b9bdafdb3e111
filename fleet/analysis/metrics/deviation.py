"""How far each UAV was from its plan: from the path that it flies when nobody commands it.

That path is flown here again, by the same guidance and flight model as in the run, so that corners
are cut and altitudes regained as they always are, and only what avoidance and faults did is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fleet.analysis.chords import Bools
from fleet.analysis.metrics.data import ESCAPES, UNMANNED, Data
from fleet.analysis.metrics.results import UavMetrics
from fleet.analysis.moments import Ints
from fleet.comms.messages import Truth
from fleet.model.flight import State
from fleet.model.scenario import Scenario, Uav
from fleet.model.trajectory import Array
from fleet.model.units import to_s, wrap_angle

STRAIGHT_RAD = 1e-7
"""A path that bends by less since the last corner has no new one."""
BEYOND_M = 1e5
BLOCK = 32
"""Places that are compared with the path at a time: few, so that they are near each other."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """So near to its planned path and altitude a UAV is on its plan."""

    path_m: float = 25.0
    altitude_m: float = 5.0


def measure_uavs(data: Data, tolerance: Tolerance) -> tuple[UavMetrics, ...]:
    """All UAVs that are on record."""
    found = []
    for uav in data.uavs:
        truths = [m for _, m in sorted(data.truths.get(uav.id, {}).items())]
        if truths:
            found.append(_measure(uav, truths, data.scenario, tolerance))
    return tuple(found)


def _measure(
    uav: Uav, truths: Sequence[Truth], scenario: Scenario, tolerance: Tolerance
) -> UavMetrics:
    times_ns = np.array([m.t_ns for m in truths], dtype=np.int64)
    places = np.array([m.position_ned_m for m in truths])
    modes = np.array([m.mode for m in truths])
    corners = planned_path(uav, scenario, truths[-1].t_ns // scenario.tick_ns)
    path_m, altitude_m = deviations(corners, places)
    off = (path_m > tolerance.path_m) | (altitude_m > tolerance.altitude_m)
    commanded, unmanned = np.isin(modes, ESCAPES), np.isin(modes, UNMANNED)
    lasting_ns = np.diff(times_ns, append=times_ns[-1])
    return UavMetrics(
        uav.id,
        to_s(int(times_ns[-1] - times_ns[0])),
        to_s(int(lasting_ns[commanded].sum())),
        to_s(int(lasting_ns[unmanned].sum())),
        float(path_m.mean()),
        float(path_m.max()),
        float(altitude_m.mean()),
        float(altitude_m.max()),
        to_s(int(lasting_ns[off].sum())),
        _over_s(times_ns, commanded),
        _over_s(times_ns, off),
    )


def _over_s(times_ns: Ints, going_on: Bools) -> float | None:
    """When something was over for good, of what went on at these times; None if never, or not."""
    last = np.flatnonzero(going_on)
    if not len(last) or last[-1] == len(times_ns) - 1:
        return None
    return to_s(int(times_ns[last[-1] + 1]))


def planned_path(uav: Uav, scenario: Scenario, ticks: int) -> Array:
    """Corners (n, 3) of the path that a UAV flies undisturbed in so many ticks, and far beyond."""
    pilot, state = scenario.pilot(uav.speed_mps), uav.state()
    plan = pilot.advance(uav.plan(), state, state)
    corners, direction = [state.position_ned_m], state
    for _ in range(ticks):
        plan, states = pilot.follow(plan, state, scenario.tick_ns)
        for before, after in pairwise([state, *states]):
            if _bends(direction, after):
                if before.position_ned_m != corners[-1]:
                    corners.append(before.position_ned_m)
                corners.append(after.position_ned_m)
                direction = after
        state = states[-1]
    north, east, down = state.position_ned_m
    along = BEYOND_M * np.array([np.cos(state.heading_rad), np.sin(state.heading_rad)])
    corners += [state.position_ned_m, (north + along[0], east + along[1], down)]
    return np.array(corners)


def _bends(since: State, now: State) -> bool:
    turned = wrap_angle(now.heading_rad - since.heading_rad)
    pitched = now.flight_path_rad - since.flight_path_rad
    return max(abs(turned), abs(pitched)) > STRAIGHT_RAD


def deviations(corners: Array, places: Array) -> tuple[Array, Array]:
    """Horizontal distance of places (n, 3) from a path, and that of altitudes at its nearest point.

    `corners` (m, 3) are joined by straight lines.
    """
    parts = [_deviations(corners, places[n : n + BLOCK]) for n in range(0, len(places), BLOCK)]
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
    return start[least <= farthest], step[least <= farthest]


def _to_lines(start: Array, step: Array, places: Array) -> tuple[Array, Array]:
    """Where on each line each place is nearest, as a fraction of it, and how far it is there."""
    length = np.maximum(np.sum(step[:, :2] ** 2, axis=1), 1e-12)
    away = places[:, None, :2] - start[:, :2]
    fraction = np.clip(np.sum(away * step[:, :2], axis=2) / length, 0.0, 1.0)
    beside = away - fraction[:, :, None] * step[:, :2]
    return fraction, np.hypot(beside[..., 0], beside[..., 1])
