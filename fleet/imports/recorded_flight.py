"""Recorded flights of a file, positions over time, as flight plans.

A flight becomes its first place and the fewest waypoints from which no recorded place is further
than a tolerance (Douglas and Peucker, The Canadian Cartographer 10, 1973). It is flown at one
speed, that with which the whole way takes as long as on record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fleet.config.scenario import ConfigTable, Point, Positive, Zone
from fleet.imports.approach import latest_approach_s
from fleet.imports.imported import ForeignTraffic, ImportedUav
from fleet.model.types import Array

BEYOND_S = 30.0
"""The last waypoint is so far beyond the last place on record."""

LATEST_S = 600.0
"""Who appears later than this after the first is left out: further back nobody knows its way."""

STEADY_SHARE = 0.1
"""Speeds that differ by less of the mean are taken for one."""


MOST_CORNERS = 1000
"""A UAV has at most 1000 waypoints, of which one may be where it appears."""


@dataclass(frozen=True, slots=True)
class RecordedFlight:
    """Where an aircraft was: times in s, shape (n,), and NED places in m, shape (n, 3).

    `velocity_ned_mps` is what the file says of the first time; all that there is of a flight with
    one place.
    """

    name: str
    line: int
    times_s: Array
    places_m: Array
    velocity_ned_mps: Point | None = None


class Tolerance3D(ConfigTable, frozen=True):
    """How far a recorded place may be from the plan."""

    across_m: Positive
    up_m: Positive

    @classmethod
    def of(cls, zone: Zone) -> Tolerance3D:
        """A twentieth of the distance required across, a tenth of that up and down."""
        return cls(0.05 * 2.0 * zone.radius_m, 0.1 * 2.0 * zone.half_height_m)


def take_flights(
    flights: Sequence[RecordedFlight], traffic: ForeignTraffic, tolerance: Tolerance3D
) -> None:
    """Add them to the traffic as UAVs, from the time on at which the first one appears."""
    begin_s = min(float(flight.times_s[0]) for flight in flights)
    end_s = max(float(flight.times_s[-1]) for flight in flights)
    if all(len(flight.times_s) == 1 for flight in flights):
        end_s += _to_come_s(flights)
    for flight in flights:
        uav = _planned(flight, begin_s, end_s, traffic, tolerance)
        if uav is not None:
            traffic.uavs.append(uav)
    traffic.duration_s = end_s - begin_s
    if any(len(uav.waypoints_ned_m) > 1 for uav in traffic.uavs):
        traffic.corner_m = min(traffic.corner_m, tolerance.across_m)


def _to_come_s(flights: Sequence[RecordedFlight]) -> float:
    """Of flights of which only one state each is known: till their latest closest point is over."""
    states = [(f.places_m[0, :2], f.velocity_ned_mps[:2]) for f in flights if f.velocity_ned_mps]
    places, velocities = (np.array(x) for x in zip(*states, strict=True))
    return 1.1 * latest_approach_s(places, velocities, np.inf) + BEYOND_S


def corners_of(places_m: Array, tolerance: Tolerance3D) -> list[int]:
    """The places to keep, in order: no other one is beyond the tolerance from their line.

    It ends early where there are more than a UAV can have, since that takes long.
    """
    keep, parts = {0, len(places_m) - 1}, [(0, len(places_m) - 1)]
    while parts and len(keep) <= MOST_CORNERS:
        first, last = parts.pop()
        if last - first < 2:
            continue
        off = _off(places_m[first : last + 1], tolerance)
        worst = int(off.argmax())
        if off[worst] > 1.0:
            keep.add(first + worst)
            parts += [(first, first + worst), (first + worst, last)]
    return sorted(keep)


def _off(places_m: Array, tolerance: Tolerance3D) -> Array:
    """How far each is from the line between the first and the last one, in tolerances."""
    start, way = places_m[0], places_m[-1] - places_m[0]
    squared = float(way[0] * way[0] + way[1] * way[1])
    from_start = places_m - start
    share = np.linspace(0.0, 1.0, len(places_m))
    if squared > 0.0:
        share = np.clip((from_start[:, :2] @ way[:2]) / squared, 0.0, 1.0)
    apart = from_start - share[:, None] * way
    across = np.hypot(apart[:, 0], apart[:, 1]) / tolerance.across_m
    off: Array = np.maximum(across, np.abs(apart[:, 2]) / tolerance.up_m)
    return off


def _planned(
    flight: RecordedFlight,
    begin_s: float,
    end_s: float,
    traffic: ForeignTraffic,
    tolerance: Tolerance3D,
) -> ImportedUav | None:
    late_s = float(flight.times_s[0]) - begin_s
    if late_s > LATEST_S:
        why = f"appears {late_s:g} s after the first aircraft, over {LATEST_S:g} s; left out"
        traffic.remark(flight.line, flight.name, why)
        return None
    corners, times = _corners(flight, end_s, tolerance)
    if len(corners) > MOST_CORNERS:
        why = f"needs more than {MOST_CORNERS - 2} waypoints; left out, unless --tolerance is wider"
        traffic.remark(flight.line, flight.name, why)
        return None
    legs = np.diff(corners, axis=0)
    lengths = np.sqrt((legs * legs).sum(axis=1))
    speed = float(lengths.sum() / (times[-1] - times[0]))
    level_m = tolerance.up_m if len(flight.times_s) > 1 else 0.0
    rates = np.where(np.abs(legs[:, 2]) > level_m, -legs[:, 2], 0.0) / np.diff(times)
    _tell(flight, end_s, traffic, lengths / np.diff(times), rates, speed)
    if not lengths[0] > 0.0:
        return _standing(flight)
    start, waypoints = corners[0], [tuple(p.tolist()) for p in corners[1:]]
    climb = float(-legs[0, 2] / lengths[0] * speed) if rates[0] else 0.0
    if late_s > 0.0:
        back = legs[0] * (late_s * speed / lengths[0])
        if climb:
            waypoints.insert(0, tuple(start.tolist()))
            back[2] = climb = 0.0
        start = start - back
        why = f"appears {late_s:g} s after the first aircraft; it begins with all others, "
        traffic.remark(flight.line, flight.name, f"{why}{late_s * speed:.0f} m further back")
    last = legs[-1] / lengths[-1] * (speed * BEYOND_S)
    waypoints[-1] = tuple((corners[-1] + last).tolist())
    rate = float((np.abs(legs[:, 2]) / lengths * speed)[rates != 0.0].max(initial=0.0))
    return ImportedUav(
        name=flight.name,
        line=flight.line,
        position_ned_m=_point(start),
        heading_deg=math.degrees(math.atan2(legs[0, 1], legs[0, 0])),
        speed_mps=speed,
        waypoints_ned_m=tuple(_point(np.array(p)) for p in waypoints),
        climb_mps=climb,
        guidance_climb_mps=rate or None,
    )


def _corners(flight: RecordedFlight, end_s: float, tolerance: Tolerance3D) -> tuple[Array, Array]:
    """Places and times of the plan's corners; of one place where its velocity leads by the end."""
    if len(flight.times_s) > 1:
        kept = corners_of(flight.places_m, tolerance)
        return flight.places_m[kept], flight.times_s[kept]
    ahead_s = max(end_s - float(flight.times_s[0]), 1.0)
    there = flight.places_m[0] + ahead_s * np.array(flight.velocity_ned_mps)
    begin = float(flight.times_s[0])
    return np.stack([flight.places_m[0], there]), np.array([begin, begin + ahead_s])


def _standing(flight: RecordedFlight) -> ImportedUav:
    """One that does not move; it is left out by its speed."""
    place = _point(flight.places_m[0])
    return ImportedUav(flight.name, flight.line, place, 0.0, 0.0, (place,))


def _point(place: Array) -> Point:
    north, east, down = (float(x) + 0.0 for x in place)
    return (north, east, down)


def _tell(
    flight: RecordedFlight,
    end_s: float,
    traffic: ForeignTraffic,
    speeds: Array,
    climbs: Array,
    speed: float,
) -> None:
    """Remark what of the flight is not flown so."""
    if len(speeds) > 1 and speeds.max() - speeds.min() > STEADY_SHARE * speed:
        traffic.remark(
            flight.line,
            flight.name,
            f"flies {speeds.min():.1f} to {speeds.max():.1f} m/s; a UAV at one speed, "
            f"{speed:.1f} m/s",
        )
    rates = np.abs(climbs)
    if len(rates) > 1 and rates.max() > 0.0:
        told = f"climbs or sinks by {rates.min():.1f} to {rates.max():.1f} m/s on {len(rates)} legs"
        traffic.remark(flight.line, flight.name, f"{told}; a UAV at the greatest, to each waypoint")
    early_s = end_s - float(flight.times_s[-1])
    if early_s > 0.0:
        why = f"ends {early_s:g} s before the last aircraft; it flies straight on"
        traffic.remark(flight.line, flight.name, why)
