"""Witnesses of an overlap: a moment at which two UAVs are deep in each other's zones, once found.

To find it takes whole trajectories. A little later they are nearly the same, and two positions are
enough to know for certain that the zones still overlap.
"""

from __future__ import annotations

import numpy as np

from fleet.model.conflict.risk import Required, normalised_separation
from fleet.model.types import Array, Position

DEEP = 0.95
"""A normalised separation at which a witness is found, so that it lasts for a while."""

SURE = 0.999
"""One that is below 1 by much more than rounding can be."""


def is_deep(one: Position, other: Position, required: Required) -> bool:
    """Whether two positions are for certain nearer than required."""
    north, east, down = (a - b for a, b in zip(one, other, strict=True))
    level_m, upright_m = SURE * required.horizontal_m, SURE * required.vertical_m
    return north * north + east * east < level_m * level_m and abs(down) < upright_m


def first_deep(relative_m: Array, required: Required) -> tuple[int, int] | None:
    """Row and sample of relative trajectories (m, n, 3) that are the first to be deep, if any.

    The first, since it comes nearer with time: so it lasts for the longest time.
    """
    deep = normalised_separation(relative_m, required) < DEEP
    ever = deep.any(axis=0)
    if not ever.any():
        return None
    sample = int(np.argmax(ever))
    return int(np.argmax(deep[:, sample])), sample
