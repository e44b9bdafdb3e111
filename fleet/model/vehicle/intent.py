"""Aims: the heading, climb and speed that a UAV flies to, and what may be next."""

from __future__ import annotations

import math

import msgspec
from msgspec import Struct

STRAIGHT = 1e-7
"""Angles (rad), climbs (m/s) and altitude errors (m) below this bend no trajectory."""

BEND_RAD = 1e-4
"""A planned change of heading below this is not worth predicting: 0.2 m in 2 km."""


class NextCourse(Struct, frozen=True, gc=False):
    """What an intent is replaced by after a time.

    The turn to the heading goes the shorter way, unless `turn_rad` (right positive) says that it is
    more than half a circle. The time is that of a UAV that changes to `speed_mps` (NaN: that keeps
    its speed): at another speed the way till then takes another time.
    """

    after_s: float
    heading_rad: float
    climb_mps: float
    level_down_m: float = math.nan
    turn_rad: float = 0.0
    speed_mps: float = math.nan

    @property
    def sense(self) -> float:
        """Of a turn of more than half a circle: 1 to the right, -1 to the left; else 0."""
        return math.copysign(1.0, self.turn_rad) if abs(self.turn_rad) > math.pi else 0.0


class Intent(Struct, frozen=True, gc=False):
    """Heading and climb to fly; `level_down_m` is where the climb levels off (NaN: it does not).

    With a level the climb only says how fast to go there at most, from above or from below. After a
    time something else may be next. The speed changes to `speed_mps` (NaN: it is kept).
    """

    heading_rad: float
    climb_mps: float
    level_down_m: float = math.nan
    then: NextCourse | None = None
    speed_mps: float = math.nan

    def after(self, time_s: float) -> Intent:
        """The same intent as seen so much later."""
        then = self.then
        if then is None:
            return self
        if time_s >= then.after_s:
            # of a long turn only half: the sense would be lost
            heading = then.heading_rad - (0.5 * then.turn_rad if then.sense else 0.0)
            return Intent(heading, then.climb_mps, then.level_down_m, None, self.speed_mps)
        left = msgspec.structs.replace(then, after_s=then.after_s - time_s)
        return msgspec.structs.replace(self, then=left)

    def at(self, speed_mps: float) -> Intent:
        """The same intent of a UAV that keeps its speed, with that speed said."""
        if not math.isnan(self.speed_mps):
            return self
        then = self.then and msgspec.structs.replace(self.then, speed_mps=speed_mps)
        return msgspec.structs.replace(self, then=then, speed_mps=speed_mps)

    @property
    def bends(self) -> bool:
        """Whether what is next is another course."""
        then = self.then
        if then is None:
            return False
        return (
            abs(math.remainder(then.heading_rad - self.heading_rad, math.tau)) > BEND_RAD
            or abs(then.turn_rad) > math.pi
            or abs(then.level_down_m - self.level_down_m) > STRAIGHT
        )
