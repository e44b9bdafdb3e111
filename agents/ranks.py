"""How good manoeuvres are of which none is safe."""

from __future__ import annotations

import numpy as np

from fleet.agents.geometry import Others
from fleet.model.conflict.blocks import BLOCK, chords_within
from fleet.model.conflict.risk import Required, normalised_separation
from fleet.model.elementary import ordered_mean
from fleet.model.types import Array

RANKED = 2.0
"""How far beyond this normalised separation others are does not count."""


def ranks(paths: Array, others: Others, required: Required) -> Array:
    """How good paths (m, n, 3) are, shape (m,): the greater the better.

    The least separation; where candidates share it (zones that overlap already), how far apart the
    rest of the path is.
    """
    nearest = _nearest(paths, others, required)
    later = ordered_mean(np.minimum(nearest, RANKED))
    return np.asarray(nearest.min(axis=1) + 0.02 * later, dtype=np.float64)


def _nearest(paths: Array, others: Others, required: Required) -> Array:
    """The normalised separation of paths (m, n, 3) from the nearest of others, shape (m, n).

    Where that is not below `RANKED` it may be told too great, but for the least of each path.
    """
    nearest = np.full(paths.shape[:2], np.inf)
    if others.scale is None:
        near = chords_within(paths, others.paths, required, RANKED)
        for start in range(0, paths.shape[1], BLOCK):
            samples = slice(start, start + BLOCK)
            chords = slice(max(0, start - 1), start + BLOCK)
            there = others.paths[near[:, chords].any(axis=1), samples]
            if len(there):
                separations = normalised_separation(paths[:, None, samples] - there, required)
                nearest[:, samples] = separations.min(axis=1)
    rest = np.flatnonzero(nearest.min(axis=1) >= RANKED)
    relative = others.relative_m(paths[rest])
    nearest[rest] = normalised_separation(relative, required).min(axis=1)
    return nearest
