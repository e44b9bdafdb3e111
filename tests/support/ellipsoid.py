"""Straight flights on the ellipsoid, reckoned by pyproj: what imports are held against."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pyproj

from fleet.imports.scenario_making import ImportedTraffic
from fleet.model.types import Array

GEOD = pyproj.Geod(ellps="WGS84")
TO_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
STEP_S = 0.25


@dataclass(frozen=True)
class GeodesicFlight:
    """A flight along a geodesic: degrees, m, true course at the start, speeds in m/s."""

    latitude: float
    longitude: float
    altitude: float
    course: float
    speed: float
    climb: float = 0.0

    def geodetic(self, times_s: Array) -> Array:
        """Latitude, longitude and altitude, shape (n, 3)."""
        n = len(times_s)
        longitude, latitude, course = (
            np.full(n, x) for x in (self.longitude, self.latitude, self.course)
        )
        longitude, latitude, _ = GEOD.fwd(longitude, latitude, course, self.speed * times_s)
        return np.column_stack([latitude, longitude, self.altitude + self.climb * times_s])

    def ecef(self, times_s: Array) -> Array:
        """Earth-centred, Earth-fixed positions, shape (n, 3)."""
        latitude, longitude, altitude = self.geodetic(times_s).T
        return np.column_stack(TO_ECEF.transform(longitude, latitude, altitude))


def nearest_by_ecef(
    one: GeodesicFlight, two: GeodesicFlight, until_s: float
) -> tuple[float, float]:
    """Time and distance of the closest point of approach of two flights."""
    times = np.arange(0.0, until_s, STEP_S)
    return _least(times, two.ecef(times) - one.ecef(times))


def nearest_of_import(made: ImportedTraffic) -> dict[tuple[str, str], tuple[float, float]]:
    """The same of all pairs of UAVs that fly straight on from their start, by their names."""
    found = {}
    states = {a.name: u.state() for a, u in zip(made.uavs, made.scenario.uav, strict=True)}
    for a, b in combinations(states, 2):
        apart = np.subtract(states[b].position_ned_m, states[a].position_ned_m)
        closing = np.subtract(states[b].velocity_ned_mps, states[a].velocity_ned_mps)
        time = max(0.0, -float(apart @ closing) / max(float(closing @ closing), 1e-12))
        found[a, b] = time, float(np.linalg.norm(apart + time * closing))
    return found


def _least(times: Array, apart: Array) -> tuple[float, float]:
    start, step = apart[:-1], np.diff(apart, axis=0)
    squared = np.maximum((step * step).sum(axis=1), 1e-12)
    share = np.clip(-(start * step).sum(axis=1) / squared, 0.0, 1.0)
    least = np.linalg.norm(start + share[:, None] * step, axis=1)
    n = int(least.argmin())
    return float(times[n] + share[n] * STEP_S), float(least[n])
