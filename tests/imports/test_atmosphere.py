"""Airspeeds: against tables of the standard atmosphere, and what a pitot tube measures."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.imports.atmosphere import (
    pressure_and_temperature,
    speed_of_sound_mps,
    true_airspeed_mps,
)

KNOT = 1852.0 / 3600.0


@pytest.mark.parametrize(
    ("altitude_m", "pressure_pa", "temperature_k"),
    [
        (0.0, 101_325.0, 288.15),
        (1000.0, 89_874.5, 281.65),
        (5000.0, 54_019.9, 255.65),
        (11_000.0, 22_632.0, 216.65),
        (20_000.0, 5_474.9, 216.65),
    ],
)
def test_pressure_and_temperature_are_those_of_the_tables(
    altitude_m: float, pressure_pa: float, temperature_k: float
) -> None:
    """ISO 2533, geopotential altitudes."""
    pressure, temperature = pressure_and_temperature(altitude_m)
    assert pressure == pytest.approx(pressure_pa, rel=2e-5)
    assert temperature == pytest.approx(temperature_k)


def test_sound_is_as_fast_as_the_tables_say() -> None:
    assert speed_of_sound_mps(0.0) == pytest.approx(340.294, abs=1e-3)
    assert speed_of_sound_mps(11_000.0) == pytest.approx(295.069, abs=1e-3)


@given(st.floats(1.0, 250.0), st.floats(-300.0, 20_000.0))
def test_a_pitot_tube_measures_the_same_pressure(calibrated: float, altitude: float) -> None:
    """The impact pressure in incompressible flow with the correction 1 + M^2/4 + M^4/40 + ..."""

    def impact_pa(speed: float, pressure: float, temperature: float) -> float:
        mach2 = speed * speed / (1.4 * 287.05287 * temperature)
        density = pressure / (287.05287 * temperature)
        series = 1.0 + mach2 / 4.0 + mach2**2 / 40.0 + mach2**3 / 1600.0 - mach2**4 / 80_000.0
        return 0.5 * density * speed * speed * series

    true = true_airspeed_mps(calibrated, altitude)
    at_sea_level = impact_pa(calibrated, 101_325.0, 288.15)
    if true < 0.9 * speed_of_sound_mps(altitude):
        there = impact_pa(true, *pressure_and_temperature(altitude))
        assert there == pytest.approx(at_sea_level, rel=1e-4)


def test_at_sea_level_they_are_the_same_and_up_high_the_true_one_is_more() -> None:
    assert true_airspeed_mps(100.0, 0.0) == pytest.approx(100.0)
    assert true_airspeed_mps(25.0, 120.0) / 25.0 == pytest.approx(1.0058, abs=2e-4)
    # 250 kt at 10,000 ft is 288 kt, at FL350 280 kt is Mach 0.82: of flight computers.
    assert true_airspeed_mps(250.0 * KNOT, 3048.0) / KNOT == pytest.approx(288.0, abs=1.0)
    mach = true_airspeed_mps(280.0 * KNOT, 10_668.0) / speed_of_sound_mps(10_668.0)
    assert mach == pytest.approx(0.82, abs=0.005)
    assert math.isfinite(true_airspeed_mps(0.0, 10_000.0))
