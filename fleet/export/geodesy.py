"""From local NED to the Earth: the tangent plane at the origin, and the ellipsoid WGS-84.

NED is level at the origin only: at distance d a constant `down` is about d^2 / 2R higher above the
ellipsoid (0.8 m at 3.2 km).
"""

from __future__ import annotations

import math

import numpy as np

from fleet.config.scenario import Origin
from fleet.model.types import Array

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR_M = SEMI_MAJOR_M * (1.0 - FLATTENING)
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
"""Square of the first eccentricity; the three before it: NGA.STND.0036 (WGS-84)."""


def ecef_m(latitude_rad: float, longitude_rad: float, height_m: float) -> Array:
    """Earth-centred, Earth-fixed position of a geodetic one."""
    sine, cosine = math.sin(latitude_rad), math.cos(latitude_rad)
    normal_m = SEMI_MAJOR_M / math.sqrt(1.0 - ECCENTRICITY_2 * sine**2)
    return np.array(
        [
            (normal_m + height_m) * cosine * math.cos(longitude_rad),
            (normal_m + height_m) * cosine * math.sin(longitude_rad),
            (normal_m * (1.0 - ECCENTRICITY_2) + height_m) * sine,
        ]
    )


def ned_axes(latitude_rad: float, longitude_rad: float) -> Array:
    """North, east and down there, each a row in Earth-centred, Earth-fixed axes."""
    sin_lat, cos_lat = math.sin(latitude_rad), math.cos(latitude_rad)
    sin_lon, cos_lon = math.sin(longitude_rad), math.cos(longitude_rad)
    return np.array(
        [
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [-sin_lon, cos_lon, 0.0],
            [-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat],
        ]
    )


def geodetic(positions_ned_m: Array, origin: Origin) -> Array:
    """Latitude and longitude in degrees and height in m, shape (N, 3), of positions in NED.

    Bowring's closed form (Survey Review 23, 1976): the latitude is right within 1e-9 degrees (0.1
    mm) wherever aircraft fly.
    """
    latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    centred = ecef_m(latitude, longitude, origin.altitude_m)
    x, y, z = (centred + positions_ned_m @ ned_axes(latitude, longitude)).T
    axial = np.hypot(x, y)
    parametric = np.arctan2(z * SEMI_MAJOR_M, axial * SEMI_MINOR_M)
    second_2 = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2)
    found = np.arctan2(
        z + second_2 * SEMI_MINOR_M * np.sin(parametric) ** 3,
        axial - ECCENTRICITY_2 * SEMI_MAJOR_M * np.cos(parametric) ** 3,
    )
    sine, cosine = np.sin(found), np.cos(found)
    height = (
        axial * cosine + z * sine - SEMI_MAJOR_M * np.sqrt(1.0 - ECCENTRICITY_2 * sine**2)
    )  # holds at the poles too, where dividing by the cosine would not
    return np.column_stack([np.degrees(found), np.degrees(np.arctan2(y, x)), height])
