"""Which of many boxes overlap, without looking at every pair of them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import Array

Places = NDArray[np.intp]

FEW = 64
"""Of so many boxes all pairs are looked at: that is the fastest up to there."""


def overlapping(low: Array, high: Array) -> tuple[Places, Places]:
    """Places (i < j) of the boxes that overlap, in order; boxes that only touch do not.

    `low` and `high` (N, 3) are the corners of each box. Boxes that lie far from each other in the
    plane of the first two axes are never compared, so that the time grows with the number of
    neighbours, where no box is much larger than the rest.
    """
    if len(low) <= FEW:
        first, second = all_pairs(len(low))
        all_meet = ((low[first] < high[second]) & (low[second] < high[first])).all(axis=1)
        return first[all_meet], second[all_meet]
    first, second = _neighbours(low, high)
    for axis in range(low.shape[1]):
        bottom, top = low[:, axis], high[:, axis]
        meet = (bottom[first] < top[second]) & (bottom[second] < top[first])
        first, second = first[meet], second[meet]
    lower, higher = np.minimum(first, second), np.maximum(first, second)
    order = np.lexsort((higher, lower))
    return lower[order], higher[order]


@lru_cache(maxsize=FEW)
def all_pairs(count: int) -> tuple[Places, Places]:
    """Places (i < j) of all pairs of so many."""
    first, second = np.triu_indices(count, 1)
    return first, second


def _neighbours(low: Array, high: Array) -> tuple[Places, Places]:
    """Each pair of boxes of one cell, or of two neighbouring ones, of a grid, once.

    Cells are as large as the largest box: those that overlap have their centres in neighbouring
    cells at most.
    """
    centre = 0.5 * (low[:, :2] + high[:, :2])
    size = max(float((high[:, :2] - low[:, :2]).max()), 1.0)
    cell = np.floor((centre - centre.min(axis=0)) / size).astype(np.int64)
    width = int(cell[:, 1].max()) + 2  # a cell to spare: the ends of two rows are no neighbours
    key = cell[:, 0] * width + cell[:, 1]
    order = np.argsort(key, kind="stable")
    keys = key[order]
    here = np.arange(len(keys))
    rows = [
        (here + 1, np.searchsorted(keys, keys + 1, "right")),
        (
            np.searchsorted(keys, keys + (width - 1), "left"),
            np.searchsorted(keys, keys + (width + 1), "right"),
        ),
    ]
    pairs = [_ranges(begin, end) for begin, end in rows]
    first = np.concatenate([order[one] for one, _ in pairs])
    second = np.concatenate([order[other] for _, other in pairs])
    return first, second


def _ranges(begin: Places, end: Places) -> tuple[Places, Places]:
    """Each place k with all of `begin[k]` to `end[k]`, the end excluded."""
    counts = end - begin
    places = np.repeat(np.arange(len(counts)), counts)
    before = np.add.accumulate(counts) - counts
    return places, np.arange(len(places)) + np.repeat(begin - before, counts)
