"""Lengths of vectors and distances of points."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fleet.model.elementary.both import Real
from fleet.model.types import Array

LEAST_SQUARE, MOST_SQUARE = 1e-280, 1e300
"""Squares between these lose nothing."""


def hypot(x: Real, y: Real, *more: Real) -> Real:
    """Length of a vector, of which the coordinates are given."""
    square = x * x + y * y
    for z in more:
        square = square + z * z
    if isinstance(square, np.ndarray):
        return _lengths(square, x, y, *more)
    return math.sqrt(square) if LEAST_SQUARE < square < MOST_SQUARE else _length(x, y, *more)


def dist(p: Sequence[float], q: Sequence[float]) -> float:
    """Distance of two points."""
    square = 0.0
    for a, b in zip(p, q, strict=True):
        square += (a - b) * (a - b)
    if LEAST_SQUARE < square < MOST_SQUARE:
        return math.sqrt(square)
    return _length(*[a - b for a, b in zip(p, q, strict=True)])


def _lengths(square: Array, *coordinates: Array) -> Array:
    usual = (square > LEAST_SQUARE) & (square < MOST_SQUARE)
    if usual.all():
        return np.sqrt(square)
    out = np.sqrt(np.where(usual, square, 0.0))
    rest = [np.broadcast_to(c, square.shape)[~usual].tolist() for c in coordinates]
    out[~usual] = [_length(*v) for v in zip(*rest, strict=True)]
    return out


def _length(*coordinates: float) -> float:
    """The same for what is so great or small that its square is no float."""
    if not any(coordinates):
        return 0.0
    sizes = [abs(float(c)) for c in coordinates]
    if math.inf in sizes:
        return math.inf
    if any(map(math.isnan, sizes)):
        return math.nan
    _, exponent = math.frexp(max(sizes))
    square = 0.0
    for size in sizes:
        part = math.ldexp(size, -exponent)
        square += part * part
    return math.ldexp(math.sqrt(square), exponent)
