"""Units that other programs write, as factors to SI and degrees."""

from __future__ import annotations

FEET_TO_M = 0.3048
KNOTS_TO_MPS = 1852.0 / 3600.0
NAUTICAL_MILES_TO_M = 1852.0
FEET_A_MINUTE_TO_MPS = FEET_TO_M / 60.0

LENGTHS = {
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "km": 1000.0,
    "ft": FEET_TO_M,
    "foot": FEET_TO_M,
    "feet": FEET_TO_M,
    "nmi": NAUTICAL_MILES_TO_M,
    "nm": NAUTICAL_MILES_TO_M,
}
"""To metres; `nm` is the nautical mile, as in aviation and in DAIDALUS."""

SPEEDS = {
    "m/s": 1.0,
    "mps": 1.0,
    "meter_per_second": 1.0,
    "km/h": 1.0 / 3.6,
    "kph": 1.0 / 3.6,
    "knot": KNOTS_TO_MPS,
    "knots": KNOTS_TO_MPS,
    "kn": KNOTS_TO_MPS,
    "kts": KNOTS_TO_MPS,
    "kt": KNOTS_TO_MPS,
    "fpm": FEET_A_MINUTE_TO_MPS,
    "ft/min": FEET_A_MINUTE_TO_MPS,
    "ft/s": FEET_TO_M,
    "fps": FEET_TO_M,
    "nmi/s": NAUTICAL_MILES_TO_M,
}
"""To m/s."""

ANGLES = {
    "deg": 1.0,
    "degree": 1.0,
    "degrees": 1.0,
    "rad": 57.29577951308232,
    "radian": 57.29577951308232,
}
"""To degrees."""

DURATIONS = {
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "ms": 1e-3,
    "min": 60.0,
    "hr": 3600.0,
    "h": 3600.0,
}
"""To seconds."""

NO_UNITS = {"none", "unitless", "unspecified", "-", ""}
"""What stands where there is no unit."""
