"""Units and angles. Inside the simulator: SI, radians, integer nanoseconds."""

from __future__ import annotations

import math

GRAVITY_MPS2 = 9.80665
"""Standard gravity (ISO 80000-3)."""

NS_PER_S = 1_000_000_000


def to_ns(seconds: float) -> int:
    """Nearest integer number of nanoseconds."""
    return round(seconds * NS_PER_S)


def to_s(nanoseconds: int) -> float:
    """Seconds as a float."""
    return nanoseconds / NS_PER_S


def wrap_angle(angle_rad: float) -> float:
    """The same direction in (-pi, pi]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped
