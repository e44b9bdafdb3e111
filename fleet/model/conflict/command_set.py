"""The command sets of eq. 7: turns and climbs that a resolver chooses among, and their bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.model.types import Array


@dataclass(frozen=True, slots=True)
class Altitudes:
    """Between which altitudes (down) a manoeuvre stays, or where it begins if that is beyond."""

    floor_down_m: float
    ceiling_down_m: float

    def level_m(self, climb_mps: float, level_down_m: float, start_down_m: float) -> float:
        """Where a climb may level off that is meant to do so at a level (NaN: nowhere).

        It may begin beyond the limits; NaN if it is not known where.
        """
        known = not math.isnan(start_down_m)
        lowest = max(self.floor_down_m, start_down_m) if known else self.floor_down_m
        highest = min(self.ceiling_down_m, start_down_m) if known else self.ceiling_down_m
        if math.isnan(level_down_m):
            level_down_m = highest if climb_mps > 0.0 else lowest
        return max(highest, min(lowest, level_down_m))


def turn_commands(maximum_rad: float, count: int) -> Array:
    """TC: `count` (odd) heading changes, equally spaced over [-maximum, maximum], 0 among them."""
    half = count // 2
    return np.asarray(maximum_rad * (np.arange(-half, half + 1) / half), dtype=np.float64)


def climb_commands(max_dive_mps: float, max_climb_mps: float, count: int) -> Array:
    """CC: `count` (odd) vertical speeds over [-max_dive, max_climb], the middle one zero.

    Equally spaced as in the paper when both bounds are alike, else equally spaced on each side.
    """
    side = count // 2 + 1
    down = np.linspace(-max_dive_mps, 0.0, side)
    return np.concatenate([down, np.linspace(0.0, max_climb_mps, side)[1:]])


def speed_commands(speeds_mps: tuple[float, float], cruise_mps: float, count: int) -> list[float]:
    """`count` (odd) speeds from the least to the greatest, equally spaced on each side of cruise.

    Cruise speed itself is left out; 0 is no speed at all.
    """
    low, high = speeds_mps
    side = count // 2
    parts = [(k + 1) / side for k in range(side)]
    slower = [cruise_mps + part * (low - cruise_mps) for part in parts]
    return slower + [cruise_mps + part * (high - cruise_mps) for part in parts]


def command_set(turns: Array, climbs: Array) -> list[tuple[float, float]]:
    """The (tc, cc) of TJ, eq. 7: every turn with no climb, then every climb with no turn.

    N_T + N_C - 1 of them: the straight one is in both families and listed once.
    """
    pairs = [(float(tc), 0.0) for tc in turns]
    return pairs + [(0.0, float(cc)) for cc in climbs if cc != 0.0]
