"""Calibrated airspeed and Mach number to true airspeed, in the standard atmosphere.

ISA (ISO 2533) up to 20 km. Above that temperature stays as it is between 11 and 20 km, which is
BlueSky's atmosphere, since its files mean that: at 30 km the pressure is 3 % less than that of ISA.
"""

from __future__ import annotations

import math

from fleet.model.units import GRAVITY_MPS2

SEA_LEVEL_PA = 101_325.0
SEA_LEVEL_K = 288.15
LAPSE_K_PER_M = -0.0065
TROPOPAUSE_M = 11_000.0
AIR_GAS_CONSTANT = 287.05287
"""J / (kg K)."""

HEAT_RATIO = 1.4


def pressure_and_temperature(altitude_m: float) -> tuple[float, float]:
    """In Pa and K."""
    below_m = min(altitude_m, TROPOPAUSE_M)
    temperature = SEA_LEVEL_K + LAPSE_K_PER_M * below_m
    exponent = -GRAVITY_MPS2 / (LAPSE_K_PER_M * AIR_GAS_CONSTANT)
    pressure = SEA_LEVEL_PA * (temperature / SEA_LEVEL_K) ** exponent
    above_m = altitude_m - below_m
    return pressure * math.exp(
        -GRAVITY_MPS2 * above_m / (AIR_GAS_CONSTANT * temperature)
    ), temperature


def speed_of_sound_mps(altitude_m: float) -> float:
    """By the temperature there."""
    _, temperature = pressure_and_temperature(altitude_m)
    return math.sqrt(HEAT_RATIO * AIR_GAS_CONSTANT * temperature)


def true_airspeed_mps(calibrated_mps: float, altitude_m: float) -> float:
    """That of a calibrated airspeed: the speed whose impact pressure (compressible) is the same.

    At sea level they are the same; at 120 m true airspeed is 0.6 % more, at 6,000 m 35 %.
    """
    pressure, _ = pressure_and_temperature(altitude_m)
    mach_0 = calibrated_mps / speed_of_sound_mps(0.0)
    impact_pa = SEA_LEVEL_PA * ((1.0 + 0.2 * mach_0 * mach_0) ** 3.5 - 1.0)
    mach = math.sqrt(5.0 * ((impact_pa / pressure + 1.0) ** (2.0 / 7.0) - 1.0))
    return mach * speed_of_sound_mps(altitude_m)
