"""The frame of imports: against geodesics on the ellipsoid."""

from __future__ import annotations

import math

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.config.scenario import Origin
from fleet.export.geodesy import geodetic
from fleet.imports.local_frame import LocalFrame, middle_of

GEOD = pyproj.Geod(ellps="WGS84")
LATITUDES = st.floats(-80.0, 80.0)
LONGITUDES = st.floats(-180.0, 180.0)


@given(LATITUDES, LONGITUDES, st.floats(0.0, 360.0), st.floats(1.0, 200_000.0))
def test_distance_and_bearing_from_the_origin_are_true(
    latitude: float, longitude: float, bearing: float, distance: float
) -> None:
    frame = LocalFrame(Origin(latitude, longitude, 0.0))
    lon, lat, _ = GEOD.fwd(longitude, latitude, bearing, distance)
    north, east = frame.point_m(lat, lon)
    assert north == pytest.approx(distance * math.cos(math.radians(bearing)), abs=1e-3)
    assert east == pytest.approx(distance * math.sin(math.radians(bearing)), abs=1e-3)
    assert frame.geodetic_deg(north, east) == pytest.approx((lat, lon), abs=1e-9)


@given(LATITUDES, LONGITUDES, *[st.floats(-100_000.0, 100_000.0)] * 2, st.floats(0.0, 360.0))
def test_a_course_is_flown_straight_on_here(
    latitude: float, longitude: float, north: float, east: float, course: float
) -> None:
    """10 km of a geodesic end within 2 m of the line, 141 km from the origin or nearer."""
    frame = LocalFrame(Origin(latitude, longitude, 0.0))
    lat, lon = frame.geodetic_deg(north, east)
    direction = frame.course_rad(north, east, course)
    lon, lat, _ = GEOD.fwd(lon, lat, course, 10_000.0)
    there = frame.point_m(lat, lon)
    ahead = north + 10_000.0 * math.cos(direction), east + 10_000.0 * math.sin(direction)
    assert math.dist(there, ahead) < 2.0


def test_who_flies_level_over_the_earth_flies_level_here() -> None:
    frame = LocalFrame(Origin(47.0, 8.0, 400.0))
    ned = frame.ned_m(np.array([47.0, 48.0]), np.array([8.0, 9.0]), np.array([1000.0, 1000.0]))
    assert ned[:, 2] == pytest.approx([-600.0, -600.0])


def test_near_the_origin_it_is_the_frame_that_exports_write() -> None:
    """At 3 km the same but for altitude / R, 0.01 %, and for the curvature of the Earth, 0.6 m."""
    origin = Origin(47.0, 8.0, 400.0)
    ned = np.array([[2000.0, -2000.0, -300.0], [0.0, 100.0, 0.0]])
    back = LocalFrame(origin).ned_m(*geodetic(ned, origin).T)
    assert np.abs(back - ned)[:, :2].max() < 0.25
    assert back[0, 2] - ned[0, 2] == pytest.approx(
        -(2000.0**2 + 2000.0**2) / 2.0 / 6.38e6, abs=0.02
    )


def test_the_middle_lies_between_also_across_the_date_line() -> None:
    assert middle_of([0.0, 0.0], [179.5, -179.5]) == Origin(0.0, 180.0, 0.0)
    middle = middle_of([50.0, 50.2], [4.0, 4.0])
    assert (middle.latitude_deg, middle.longitude_deg) == (50.1, 4.0)
