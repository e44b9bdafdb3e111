"""The way from a state to a point: turn at the limit, then straight on.

The turn goes to the point's side. If the point is inside the turning circle there, the way begins
with a turn to the other side, until it is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from msgspec import Struct

from fleet.model.elementary import acos, atan2, hypot, sincos
from fleet.model.units import wrap_angle
from fleet.model.vehicle.flight import State

BEHIND = 1e-6
"""A point behind which is so little to the left of the line is turned to by the right: rounding."""

ON_COURSE_RAD = 1e-3
"""So little to the wrong side is rounding, and not a full circle short of it."""


class TangentPath(Struct, frozen=True, gc=False):
    """The way to a goal: turn at the limit, right positive, then straight on to it.

    `centre_m` is how far the goal is from the centre of the turning circle. A turn `away` only
    brings the goal out of the turning circle on its side.
    """

    turn_rad: float
    straight_m: float = 0.0
    centre_m: float = 0.0
    away: bool = False

    @property
    def first_rad(self) -> float:
        """What the controller is told, which turns the shorter way: of a long turn the half."""
        return 0.5 * self.turn_rad if abs(self.turn_rad) > math.pi else self.turn_rad

    @property
    def twofold(self) -> bool:
        """Whether another turn follows, before it is straight on."""
        return self.away or abs(self.turn_rad) > math.pi

    def turned_rad(self, radius_m: float, stop_m: float) -> float:
        """How much of the turn is flown until the goal is `stop_m` away, or else all of it."""
        turn = abs(self.turn_rad)
        if self.twofold:
            return abs(self.first_rad)
        if self.straight_m >= stop_m or self.centre_m == 0.0:
            return turn
        squares = radius_m * radius_m + self.centre_m * self.centre_m - stop_m * stop_m
        cosine = squares / (2.0 * radius_m * self.centre_m)
        short = acos(max(-1.0, min(1.0, cosine)))
        return max(0.0, turn - atan2(radius_m, self.straight_m) + 0.5 * math.pi - short)

    def state_at(
        self, state: State, radius_m: float, turned_rad: float, straight_m: float, down_m: float
    ) -> State:
        """Where a UAV is that has turned so far, and then flown so much straight on."""
        side = math.copysign(1.0, self.turn_rad)
        heading = state.heading_rad + side * turned_rad
        (sine, cosine), (start_sine, start_cosine) = sincos(heading), sincos(state.heading_rad)
        north, east = sine - start_sine, start_cosine - cosine
        return State(
            state.north_m + side * radius_m * north + straight_m * cosine,
            state.east_m + side * radius_m * east + straight_m * sine,
            down_m,
            state.speed_mps,
            wrap_angle(heading),
        )


def tangent_path(
    state: State, goal: Sequence[float], radius_m: float, within_m: float
) -> TangentPath:
    """The way to a goal at a turning radius.

    A goal that is inside the turning circle by no more than `within_m` is passed as near as a turn
    comes to it.
    """
    to_north, to_east = goal[0] - state.north_m, goal[1] - state.east_m
    ahead_east, ahead_north = sincos(state.heading_rad)
    forward = to_north * ahead_north + to_east * ahead_east
    right = to_east * ahead_north - to_north * ahead_east
    side = 1.0 if right >= -BEHIND * abs(forward) else -1.0
    # As seen from the centre of the circle, the UAV being to its left (mirrored for a left turn).
    aside, inner = side * right - radius_m, radius_m - within_m
    square = forward * forward + aside * aside
    centre = math.sqrt(square)
    if centre < inner:
        # As seen from the centre of the other circle, that of this one moves round it.
        distance = hypot(forward, side * right + radius_m)
        squares = 4.0 * radius_m * radius_m + distance * distance - inner * inner
        cosine = squares / (4.0 * radius_m * distance)
        turn = atan2(forward, side * right + radius_m) + acos(min(1.0, cosine))
        return TangentPath(-side * turn, away=True)
    tangent = math.sqrt(max(0.0, square - radius_m * radius_m))
    # The angles of (forward, aside) and (tangent, radius) together.
    turn = atan2(aside * tangent + forward * radius_m, forward * tangent - aside * radius_m)
    if turn < -ON_COURSE_RAD:
        turn += math.tau
    return TangentPath(side * turn, tangent, centre)
