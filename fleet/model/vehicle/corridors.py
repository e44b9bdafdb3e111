"""Corridors: what one can say of a course without samples of it, for a few UAVs the cheaper way."""

from __future__ import annotations

import math

from msgspec import Struct


class Corridor(Struct, frozen=True, gc=False):
    """A straight line in the plane from now on, and how far a UAV strays from it at most.

    It holds for `until_s`; afterwards all that is known is the greatest speed. Down stays between
    `low_m` and `high_m`, that of the lower altitude being `high_m`.
    """

    north_m: float
    east_m: float
    to_north_mps: float
    to_east_mps: float
    stray_m: float
    low_m: float
    high_m: float
    fastest_mps: float
    until_s: float = math.inf
