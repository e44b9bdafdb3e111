"""NED to latitude and longitude, against values computed by other programs and its own inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.config.scenario import Origin
from fleet.export.geodesy import ecef_m, geodetic, ned_axes

DEGREE_M = 111_319.0  # of longitude at the equator


@pytest.mark.parametrize(
    ("origin", "ned_m", "expected"),
    [  # expected: pymap3d 3.2.0, ned2geodetic
        (
            Origin(47.397742, 8.545594, 488.0),
            (1000.0, 2000.0, -300.0),
            (47.4067323557533, 8.572088905094605, 788.3914456290184),
        ),
        (
            Origin(-33.9, 151.2, 10.0),
            (-50000.0, 30000.0, -1000.0),
            (-34.35024144817525, 151.5260096970578, 1277.1122920352618),
        ),
    ],
)
def test_positions_agree_with_another_library(
    origin: Origin, ned_m: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    (found,) = geodetic(np.array([ned_m]), origin)
    assert found[:2] == pytest.approx(expected[:2], abs=1e-10)
    assert found[2] == pytest.approx(expected[2], abs=1e-6)


def test_earth_centred_positions_of_known_places() -> None:
    assert ecef_m(0.0, 0.0, 0.0) == pytest.approx([6_378_137.0, 0.0, 0.0])
    assert ecef_m(math.pi / 2, 0.0, 0.0) == pytest.approx([0.0, 0.0, 6_356_752.314245], abs=1e-6)


@pytest.mark.parametrize("latitude_deg", [-90.0, -89.9, -33.9, 0.0, 47.397742, 90.0])
def test_a_position_is_found_again(latitude_deg: float) -> None:
    origin = Origin(latitude_deg, 179.99, 100.0)
    rng = np.random.default_rng(1)
    ned_m = rng.uniform(-50_000.0, 50_000.0, (200, 3)) * (1.0, 1.0, 0.2)
    latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    centre, axes = ecef_m(latitude, longitude, origin.altitude_m), ned_axes(latitude, longitude)
    for position, (lat, lon, height) in zip(ned_m, geodetic(ned_m, origin), strict=True):
        back = axes @ (ecef_m(math.radians(lat), math.radians(lon), height) - centre)
        assert back == pytest.approx(position, abs=1e-4)
        assert -180.0 <= lon <= 180.0


def test_the_origin_is_where_the_scenario_says_and_east_is_east() -> None:
    origin = Origin(0.0, 10.0, 5.0)
    here, east, north, above = geodetic(
        np.array([[0.0, 0.0, 0.0], [0.0, 100.0, 0.0], [100.0, 0.0, 0.0], [0.0, 0.0, -50.0]]), origin
    )
    assert here == pytest.approx([0.0, 10.0, 5.0])
    assert east[1] - 10.0 == pytest.approx(100.0 / DEGREE_M, rel=1e-3)
    assert north[0] == pytest.approx(100.0 / 110_574.0, rel=1e-3)  # a degree of latitude there
    assert above == pytest.approx([0.0, 10.0, 55.0])
