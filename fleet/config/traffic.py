"""Generated traffic: `converge` and `crossing`, a pure function of the table and the seed."""

from __future__ import annotations

import math
import random
from functools import lru_cache

from fleet.config.scenario import Converge, Crossing, Point, Scenario, Uav
from fleet.errors import TooDenseError
from fleet.model.conflict.risk import Required
from fleet.model.elementary import dist, sin, sincos

ATTEMPTS = 10_000


def uavs_of(scenario: Scenario) -> tuple[Uav, ...]:
    """The UAVs of a scenario: its own list, or the generated one, in ID order.

    Raises:
        TooDenseError: the box is too small for that many protected zones.

    """
    if isinstance(scenario.generate, Converge):
        return converge(scenario.generate, scenario.required().horizontal_m)
    if isinstance(scenario.generate, Crossing):
        return crossing(scenario.generate, scenario)
    return tuple(sorted(scenario.uav, key=lambda u: u.id))


def converge(table: Converge, required_m: float) -> tuple[Uav, ...]:
    """UAV 1 west of the centre flying east, the others clockwise from it, all meeting there.

    Raises:
        TooDenseError: neighbours would start nearer than `required_m`.

    """
    apart = 2.0 * table.radius_m * sin(math.pi / table.count)
    if table.count > 1 and apart < required_m:
        raise TooDenseError(
            f"{table.count} UAVs on a circle of {table.radius_m:g} m start {apart:.0f} m apart, "
            f"inside each other's protected zones; raise generate.radius_m"
        )
    out = []
    for k in range(table.count):
        bearing = math.radians(-90.0 + 360.0 * k / table.count)
        start = _at(bearing, table.radius_m, -table.altitude_m)
        beyond = _at(bearing, -2.0 * table.radius_m, -table.altitude_m)
        heading = math.degrees(math.remainder(bearing + math.pi, math.tau))
        goal = _at(bearing, -table.radius_m, -table.altitude_m)
        out.append(Uav(k + 1, start, heading, (goal, beyond), table.speed_mps))
    return tuple(out)


def crossing(table: Crossing, scenario: Scenario) -> tuple[Uav, ...]:
    """Positions, altitudes and headings uniform in a box; each bound straight across it and beyond.

    No two protected zones overlap at the start.
    """
    return _crossing(table, scenario.seed, scenario.required())


@lru_cache(maxsize=4)
def _crossing(table: Crossing, seed: int, required: Required) -> tuple[Uav, ...]:
    """Everybody in a process asks for the same."""
    rng = random.Random(seed)
    side = 1000.0 * math.sqrt(table.count / table.density_per_km2)
    placed: list[Point] = []
    out: list[Uav] = []
    for _ in range(ATTEMPTS):
        north, east, up, turn = (rng.random() for _ in range(4))
        altitude = table.min_altitude_m + up * (table.max_altitude_m - table.min_altitude_m)
        start = (side * (north - 0.5), side * (east - 0.5), -altitude)
        if any(
            abs(start[2] - p[2]) < required.vertical_m
            and dist(start[:2], p[:2]) < required.horizontal_m
            for p in placed
        ):
            continue
        heading = math.tau * (turn - 0.5)
        east_part, north_part = sincos(heading)
        goal = (start[0] + side * north_part, start[1] + side * east_part, start[2])
        placed.append(start)
        out.append(Uav(len(out) + 1, start, math.degrees(heading), (goal,), table.speed_mps))
        if len(out) == table.count:
            return tuple(out)
    raise TooDenseError(
        f"no room for {table.count} UAVs at {table.density_per_km2:g} per km^2 without "
        "overlapping zones; lower generate.density_per_km2"
    )


def _at(bearing_rad: float, distance_m: float, down_m: float) -> Point:
    # Rounded, so that UAVs on the axes stand exactly on them.
    sine, cosine = sincos(bearing_rad)
    north, east = (round(distance_m * part, 6) + 0.0 for part in (cosine, sine))
    return (north, east, down_m)


def participants(scenario: Scenario) -> list[int]:
    """Numbers of all who take part in a run: the coordinator (0), where there is one, the UAVs."""
    first = [0] if scenario.coordination.electors == "coordinator" else []
    return first + [u.id for u in uavs_of(scenario)]
