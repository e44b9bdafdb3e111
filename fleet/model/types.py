"""Names for what everybody uses: arrays, positions, pairs, and the coordinator's number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COORDINATOR = 0
"""The coordinator's number in messages; UAVs count from 1."""

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Integers = NDArray[np.int64]
Truths = NDArray[np.bool_]

Position = tuple[float, float, float]
"""North, east, down (m)."""

Pair = tuple[int, int]
"""IDs of two UAVs, the lower first."""
