"""Trajectories compared in blocks of samples: most of two flights is too far apart to be looked at.

Each trajectory knows how far it strays from where it is at the beginning of a block. Two blocks
whose beginnings are further apart than that, and than what is required, need not be compared sample
by sample. What is found is the same as by comparing all samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fleet.model.conflict.boxes import Places
from fleet.model.conflict.risk import (
    Required,
    chord_overlaps,
    first_overlap_s,
    normalised_separation,
)
from fleet.model.types import Array

BLOCK = 8
"""Chords in a block."""

SLACK = 1e-9
"""Relative errors of rounding below this never leave a block out."""

FEW_PAIRS = 96
"""So few pairs of trajectories are compared by all samples sooner."""

NEARBY = 2.0
"""The least separation is sought among those who come within this first."""

BETWEEN = np.linspace(0.0, 1.0, 17)
"""Where on the chord between two samples the least separation is sought."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Trajectories (..., n, 3): where each block of them begins, and how far it strays from there.

    `begin` has shape (..., b, 3), `level_m` and `upright_m` (..., b).
    """

    paths: Array
    begin: Array
    level_m: Array
    upright_m: Array


def in_blocks(paths: Array) -> Blocks:
    """Trajectories (..., n, 3) with what is to be known of their blocks."""
    parts = paths[..., _samples(paths.shape[-2]), :]
    begin = parts[..., 0, :]
    strays = parts[..., 1:, :] - begin[..., None, :]
    north, east = strays[..., 0], strays[..., 1]
    level = np.sqrt((north * north + east * east).max(axis=-1))
    return Blocks(paths, begin, level, np.abs(strays[..., 2]).max(axis=-1))


def first_overlaps_s(
    one: Array, other: Array, times_s: Array, required: Required, scale: Array | None = None
) -> Array:
    """When trajectories first overlap with others, at the times (n,); inf where they do not.

    Both are broadcast against each other: (m, 1, n, 3) and (k, n, 3) give all pairs, (m, k).
    `scale` (k, 1, 3) is laid on relative positions, as `Growth.scale` makes it.
    """
    if (one[..., 0, 0] + other[..., 0, 0]).size > FEW_PAIRS:
        return in_blocks_s(in_blocks(one), in_blocks(other), times_s, required, scale)
    relative = one - other
    return first_overlap_s(relative if scale is None else relative * scale, times_s, required)


def in_blocks_s(
    one: Blocks, other: Blocks, times_s: Array, required: Required, scale: Array | None = None
) -> Array:
    """The same, by looking at blocks first."""
    level, upright = _apart(one, other)
    first = np.full(level.shape[:-1], np.inf)
    level_m, upright_m = np.array(required.horizontal_m), np.array(required.vertical_m)
    if scale is not None:
        level_m, upright_m = level_m / scale[..., 0], upright_m / scale[..., 2]
    near = (level < level_m * (1.0 + SLACK)) & (upright < upright_m * (1.0 + SLACK))
    *pair, block = np.nonzero(near)
    if not len(block):
        return first
    relative = _relative(one, other, pair, block)
    if scale is not None:
        relative *= np.broadcast_to(scale, (*near.shape[:-1], 1, 3))[tuple(pair)]
    row, chord, enter = chord_overlaps(relative, required)
    interval = block[row] * BLOCK + chord
    there = interval < len(times_s) - 1  # the last block may be filled up
    row, interval, enter = row[there], interval[there], enter[there]
    when = times_s[interval] + enter * np.diff(times_s)[interval]
    np.minimum.at(first, tuple(p[row] for p in pair), when)
    return first


def least_separations(
    paths: Array, others: Array, required: Required, scale: Array | None = None
) -> Array:
    """Least normalised separation of m trajectories from any of k others, shape (m,).

    `paths` are (m, n, 3), `others` (k, n, 3); `scale` (k, 1, 3) is laid on relative positions.
    """
    if scale is not None:
        return _least_of_all((paths[:, None] - others) * scale, required)
    if len(paths) * len(others) <= FEW_PAIRS:
        return _least_separations(paths, others, required)
    near = others[chords_within(paths, others, required, NEARBY).any(axis=1)]
    least = np.full(len(paths), np.inf)
    if len(near):
        least = _least_separations(paths, near, required)
    apart = least >= NEARBY
    if apart.any():
        least[apart] = _least_separations(paths[apart], others, required)
    return least


def _least_separations(paths: Array, others: Array, required: Required) -> Array:
    if len(paths) * len(others) <= FEW_PAIRS:
        return _least_of_all(paths[:, None] - others, required)
    nearest = _nearest_blocks(in_blocks(paths[:, None]), in_blocks(others), required)
    return _least_of(*nearest, required)


def _least_of_all(relative: Array, required: Required) -> Array:
    """The least of each of m, of relative positions (m, k, n, 3)."""
    m, k, n, _ = relative.shape
    upper = np.full(m, np.inf)
    return _least_of(np.repeat(np.arange(m), k), relative.reshape(-1, n, 3), upper, required)


def _least_of(mine: Places, relative: Array, upper: Array, required: Required) -> Array:
    """The least of each of m, of whom the rows (r, n, 3) are, and than what it is not greater."""
    steps = relative[:, 1:] - relative[:, :-1]
    # A chord comes no nearer than the mean of its ends less half its length.
    ends = normalised_separation(relative, required)
    bound = 0.5 * (ends[:, 1:] + ends[:, :-1] - normalised_separation(steps, required))
    np.minimum.at(upper, mine, ends.min(axis=1))
    row, chord = np.nonzero(bound <= (upper * (1.0 + SLACK))[mine, None])
    chords = relative[row, chord][:, None] + steps[row, chord][:, None] * BETWEEN[:, None]
    least = np.full(len(upper), np.inf)
    np.minimum.at(least, mine[row], normalised_separation(chords, required).min(axis=1))
    return least


def chords_within(
    paths: Array, others: Array, required: Required, separation: float
) -> NDArray[np.bool_]:
    """On which chords others (k, n, 3) may come within a normalised separation of any of paths.

    `paths` are (m, n, 3); shape (k, n - 1). Elsewhere all of them stay further apart.
    """
    reach = np.array([required.horizontal_m, required.horizontal_m, required.vertical_m])
    reach *= separation * (1.0 + SLACK)
    low, high = paths.min(axis=0) - reach, paths.max(axis=0) + reach
    low, high = np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])
    bottom = np.minimum(others[:, :-1], others[:, 1:])
    top = np.maximum(others[:, :-1], others[:, 1:])
    meet = (top > low) & (bottom < high)
    near: NDArray[np.bool_] = meet[..., 0] & meet[..., 1] & meet[..., 2]
    return near


def _nearest_blocks(one: Blocks, other: Blocks, required: Required) -> tuple[Places, Array, Array]:
    """Of whom, and how (rows, BLOCK + 1, 3), those blocks are flown that may be the nearest.

    And a separation (m,) that is not below the least.
    """
    level, upright = _apart(one, other)
    lower = np.maximum(level / required.horizontal_m, upright / required.vertical_m)
    upper = normalised_separation(one.begin - other.begin, required).min(axis=(1, 2))
    mine, its, block = np.nonzero(lower <= (upper * (1.0 + SLACK))[:, None, None])
    return mine, _relative(one, other, [mine, its], block), upper


def _apart(one: Blocks, other: Blocks) -> tuple[Array, Array]:
    """How far apart blocks are at least, level and upright; not below 0."""
    relative = one.begin - other.begin
    north, east = relative[..., 0], relative[..., 1]
    level = np.sqrt(north * north + east * east)
    level -= one.level_m + other.level_m
    upright = np.abs(relative[..., 2]) - (one.upright_m + other.upright_m)
    return np.maximum(level, 0.0), np.maximum(upright, 0.0)


def _relative(one: Blocks, other: Blocks, pair: Sequence[Places], block: Places) -> Array:
    """Relative positions (rows, BLOCK + 1, 3) in some blocks of some pairs."""
    shape = np.broadcast_shapes(one.paths.shape, other.paths.shape)
    where = (*(p[:, None] for p in pair), _samples(shape[-2])[block])
    mine, its = (np.broadcast_to(b.paths, shape)[where] for b in (one, other))
    relative: Array = mine - its
    return relative


@lru_cache(maxsize=16)
def _samples(count: int) -> Places:
    """The samples of each block, shape (b, BLOCK + 1); the last one fills up the last block."""
    begins = np.arange(0, max(1, count - 1), BLOCK)
    samples: Places = np.minimum(begins[:, None] + np.arange(BLOCK + 1), count - 1)
    return samples
