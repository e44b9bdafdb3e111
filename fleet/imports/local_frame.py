"""From latitude, longitude and altitude to NED about an origin, by the library pyproj.

North and east are those of the azimuthal equidistant projection of WGS-84 about the origin:
distances and bearings from there are true, and elsewhere distances are too long by less than
d^2 / 6R^2 (at 100 km by 4 parts in 100,000). Down is the altitude of the origin less that of the
aircraft, so that who flies level over the curved Earth flies level here too. In a tangent plane, as
exports take NED, it would sink and rise: by d^2 / 2R, 8 m at 10 km and 785 m at 100 km. Distances
across are those on the ellipsoid, which at an altitude h are h / R too short: 0.3 % at 20 km.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fleet.config.scenario import Origin
from fleet.extras import import_extra
from fleet.model.types import Array

AHEAD_M = 1000.0
"""How far ahead one looks to see a course in the projection."""


class LocalFrame:
    """NED about an origin; raises MissingExtraError where pyproj is not installed."""

    def __init__(self, origin: Origin) -> None:
        pyproj = import_extra("pyproj", "tracks", "importing positions on Earth")
        self.origin = origin
        self._geod = pyproj.Geod(ellps="WGS84")
        self._projection = pyproj.Proj(
            proj="aeqd", lat_0=origin.latitude_deg, lon_0=origin.longitude_deg, ellps="WGS84"
        )

    def ned_m(self, latitude_deg: Array, longitude_deg: Array, altitude_m: Array) -> Array:
        """Positions north, east, down, shape (n, 3)."""
        east, north = self._projection(np.array(longitude_deg), np.array(latitude_deg))
        return np.column_stack([north, east, self.origin.altitude_m - np.asarray(altitude_m)]) + 0.0

    def point_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """North and east of one point."""
        east, north = self._projection(longitude_deg, latitude_deg)
        return north + 0.0, east + 0.0

    def geodetic_deg(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Latitude and longitude of one point."""
        longitude, latitude = self._projection(east_m, north_m, inverse=True)
        return latitude, longitude

    def course_rad(self, north_m: float, east_m: float, true_deg: float) -> float:
        """The direction here, clockwise from north, of a true course that is flown from a point.

        Elsewhere than at the origin's longitude true north is not quite that of the frame.
        """
        latitude, longitude = self.geodetic_deg(north_m, east_m)
        longitude, latitude, _ = self._geod.fwd(longitude, latitude, true_deg, AHEAD_M)
        north, east = self.point_m(latitude, longitude)
        return math.atan2(east - east_m, north - north_m)


def middle_of(latitude_deg: Sequence[float], longitude_deg: Sequence[float]) -> Origin:
    """An origin in the middle of some places, at altitude 0; also across the date line."""
    latitudes, longitudes = np.radians(latitude_deg), np.radians(longitude_deg)
    x = (np.cos(latitudes) * np.cos(longitudes)).mean()
    y = (np.cos(latitudes) * np.sin(longitudes)).mean()
    z = np.sin(latitudes).mean()
    latitude = math.degrees(math.atan2(z, math.hypot(x, y)))
    longitude = math.degrees(math.atan2(y, x))
    return Origin(round(latitude, 4) + 0.0, round(longitude, 4) + 0.0, 0.0)
