"""Sums of floats in a fixed order.

numpy adds in blocks that depend on the processor, Python from 3.12 on with a compensation.
"""

from __future__ import annotations

import numpy as np

from fleet.model.types import Array


def ordered_sum(values: Array) -> Array:
    """Sum over the last axis, from the first to the last; 0 where it is empty."""
    if not values.shape[-1]:
        return np.zeros(values.shape[:-1])
    return np.asarray(np.add.accumulate(values, axis=-1)[..., -1])


def ordered_mean(values: Array) -> Array:
    """Mean over the last axis."""
    out: Array = ordered_sum(values) / values.shape[-1]
    return out
