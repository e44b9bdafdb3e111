"""Changes of speed: at the limit of acceleration to another speed, which is then held.

A course may turn meanwhile. With V = V0 + a t the turn rate at the bank limit is K / V, where
K = g tan(bank), so that the heading changes by (K / a) ln(V / V0), to the right or left; and with
north and east as the parts of a complex number the way flown is

    V0^2 / (2a + iK) ((V / V0)^2 e^(i psi) - e^(i psi0)).

For a = 0 that is the circle, for K = 0 the straight line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.model.elementary import exp, log, sincos
from fleet.model.types import Array

STEADY_MPS = 1e-6
"""Speeds nearer to each other are the same."""

MOST = 700.0
"""Exponents are kept below this: what turns for so long does not end within the change."""


@dataclass(frozen=True, slots=True)
class SpeedingPath:
    """North and east flown (k, n), and heading and speed by then."""

    north_m: Array
    east_m: Array
    heading_rad: Array
    speed_mps: Array


@dataclass(frozen=True, slots=True)
class SpeedChanges:
    """How k of m courses change their speed: their rows, and arrays of shape (k,)."""

    rows: NDArray[np.intp]
    from_mps: Array
    to_mps: Array
    rate_mps2: Array
    time_s: Array

    def way(self, heading_rad: Array, turn_rad: Array, grip_mps2: float, t: Array) -> SpeedingPath:
        """What is flown by the times t (k, n) within the change, while turning by an angle (k,).

        `grip_mps2` is K.
        """
        start, a = self.from_mps[:, None], self.rate_mps2[:, None]
        side, turn = np.sign(turn_rad)[:, None], np.abs(turn_rad)[:, None]
        turned_at = start * exp(np.clip(a * turn / grip_mps2, -MOST, MOST))
        speed = start + a * t
        turning = np.where(a > 0.0, np.minimum(speed, turned_at), np.maximum(speed, turned_at))
        grip = side * grip_mps2
        heading = heading_rad[:, None] + grip / a * log(turning / start)
        (start_sine, start_cosine), (sine, cosine) = sincos(heading_rad[:, None]), sincos(heading)
        north = turning * turning * cosine - start * start * start_cosine
        east = turning * turning * sine - start * start * start_sine
        size = 4.0 * a * a + grip * grip
        straight = (speed * speed - turning * turning) / (2.0 * a)
        return SpeedingPath(
            (2.0 * a * north + grip * east) / size + straight * cosine,
            (2.0 * a * east - grip * north) / size + straight * sine,
            heading,
            speed,
        )


def speed_changes(speed_mps: Array, to_mps: Array | None, limit_mps2: float) -> SpeedChanges | None:
    """How speeds (m,) change to others (NaN: not at all); None if none does."""
    if to_mps is None:
        return None
    rows = np.flatnonzero(np.abs(to_mps - speed_mps) > STEADY_MPS)
    if not len(rows):
        return None
    start, to = speed_mps[rows], to_mps[rows]
    rate = np.copysign(limit_mps2, to - start)
    return SpeedChanges(rows, start, to, rate, (to - start) / rate)


def flown_m(from_mps: Array, to_mps: Array, limit_mps2: float, time_s: Array) -> Array:
    """How far it is flown in a time, changing from one speed to another and holding that."""
    rate = np.copysign(limit_mps2, to_mps - from_mps)
    changing = np.minimum(time_s, (to_mps - from_mps) / rate)
    way: Array = (
        from_mps * changing + 0.5 * rate * changing * changing + to_mps * (time_s - changing)
    )
    return way


def time_to_fly_s(from_mps: Array, to_mps: Array, limit_mps2: float, way_m: Array) -> Array:
    """How long a way takes, changing from one speed to another and holding that."""
    rate = np.copysign(limit_mps2, to_mps - from_mps)
    lasts = (to_mps - from_mps) / rate
    left = way_m - 0.5 * (from_mps + to_mps) * lasts
    reached = np.sqrt(np.maximum(from_mps * from_mps + 2.0 * rate * way_m, 0.0))
    return np.where(left < 0.0, (reached - from_mps) / rate, lasts + left / to_mps)
