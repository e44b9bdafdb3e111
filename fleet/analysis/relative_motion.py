"""Geometry between two true states: relative motion along a chord, solved in closed form.

A run is on record at ticks. Between two ticks the relative position of a pair is taken as linear,
r(s) = r0 + s d with s in [0, 1]; everything here is exact for that. A chord is given by both its
ends, arrays of shape (n, 3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import Array

Bools = NDArray[np.bool_]

ROUNDING = 1e-9
"""More than rounding can change a separation."""


def in_zone_units(relative_m: Array, horizontal_m: float, vertical_m: float) -> Array:
    """Positions (..., 3) in units of a cylinder: it becomes radius 1, height from -1 to 1."""
    unit: Array = relative_m / np.array([horizontal_m, horizontal_m, vertical_m])
    return unit


def horizontal_distance(unit: Array) -> Array:
    """Horizontal distances of positions (..., 3)."""
    distances: Array = np.sqrt(unit[..., 0] ** 2 + unit[..., 1] ** 2)  # 15 times faster than hypot
    return distances


def unit_separation(unit: Array) -> Array:
    """Normalised separation max(horizontal, vertical) of positions (..., 3) in such units."""
    return np.maximum(horizontal_distance(unit), np.abs(unit[..., 2]))


def bound(start: Array, end: Array) -> Array:
    """What the separation is at least along a chord, shape (n,): it changes no faster than r."""
    return unit_separation(start) - unit_separation(end - start)


def along(start: Array, end: Array, fraction: Array) -> Array:
    """Positions (n, 3) at these fractions (n,) of the chords."""
    return start + (end - start) * fraction[:, None]


def closest(start: Array, end: Array) -> Array:
    """Fraction (n,) of each chord at which the Euclidean distance (eq. 4) is least."""
    step = end - start
    square = np.sum(step * step, axis=1)
    towards = -np.sum(start * step, axis=1)
    return np.clip(_ratio(towards, square), 0.0, 1.0)


def least(start: Array, end: Array) -> tuple[Array, Array]:
    """Least separation on each chord (units of the cylinder), and the first fraction with it.

    Ends are taken as they are, so that what is found does not depend on how a flight is cut into
    chords. Between them it is looked for only where the separation turns (`turns`).
    """
    values, fractions = unit_separation(start), np.zeros(len(start))
    turning = np.flatnonzero(turns(start, end))
    inner, there = _lowest(start[turning], end[turning])
    lower = inner < values[turning]
    values[turning[lower]], fractions[turning[lower]] = inner[lower], there[lower]
    last = unit_separation(end)
    at_end = last < values
    return np.where(at_end, last, values), np.where(at_end, 1.0, fractions)


def turns(start: Array, end: Array) -> Bools:
    """Whether the separation falls at the start of a chord and rises at its end, shape (n,).

    It is convex along a chord, being a maximum of two convex functions: where it does not turn it
    is least at an end.
    """
    step = end - start
    return _rises(start, -step) & _rises(end, step)


def _rises(place: Array, step: Array) -> Bools:
    """Whether the separation rises from these places in these directions."""
    outwards = place[:, 0] * step[:, 0] + place[:, 1] * step[:, 1] > 0.0
    upwards = place[:, 2] * step[:, 2] > 0.0
    horizontal, vertical = horizontal_distance(place), np.abs(place[:, 2])
    return (outwards & (horizontal >= vertical)) | (upwards & (vertical >= horizontal))


def _lowest(start: Array, end: Array) -> tuple[Array, Array]:
    """Least separation within each chord, and the first fraction with it.

    It is least where the horizontal distance is, or where both distances are equal:
    |horizontal|^2 = vertical^2, a quadratic. Where the vertical one is least, namely 0, it is not
    the greater one.
    """
    a, b, c, v, w = _coefficients(start, end)
    equal = _roots(a - w * w, b - v * w, c - v * v)
    candidates = np.stack([_ratio(-b, a), *equal], axis=1)
    candidates = np.sort(np.clip(np.nan_to_num(candidates), 0.0, 1.0), axis=1)
    values = unit_separation(start[:, None] + (end - start)[:, None] * candidates[:, :, None])
    first = np.argmin(values, axis=1)
    rows = np.arange(len(first))
    return values[rows, first], candidates[rows, first]


def inside(start: Array, end: Array) -> tuple[Array, Array]:
    """Fractions (n,) at which each chord enters and leaves the cylinder; NaN where it never does.

    Whether an end is inside is decided by the end itself, so that chords fit together.
    """
    a, b, c, v, w = _coefficients(start, end)
    horizontal = _span(a, b, c - 1.0)
    vertical = _span(w * w, v * w, v * v - 1.0)
    enter = np.maximum(horizontal[0], vertical[0])
    leave = np.minimum(horizontal[1], vertical[1])
    enter = np.where(unit_separation(start) < 1.0, 0.0, np.clip(enter, 0.0, 1.0))
    leave = np.where(unit_separation(end) < 1.0, 1.0, np.clip(leave, 0.0, 1.0))
    hit = enter < leave
    return np.where(hit, enter, np.nan), np.where(hit, leave, np.nan)


def _coefficients(start: Array, end: Array) -> tuple[Array, Array, Array, Array, Array]:
    """a, b, c of the horizontal distance squared, a s^2 + 2 b s + c; v, w of the height v + w s."""
    step = end - start
    a = step[:, 0] ** 2 + step[:, 1] ** 2
    b = start[:, 0] * step[:, 0] + start[:, 1] * step[:, 1]
    c = start[:, 0] ** 2 + start[:, 1] ** 2
    return a, b, c, start[:, 2], step[:, 2]


def _span(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Where a s^2 + 2 b s + c < 0 for a >= 0: from, to; (inf, -inf) where nowhere."""
    low, high = _roots(a, b, c)
    low, high = np.minimum(low, high), np.maximum(low, high)
    still = a == 0.0
    everywhere = still & (c < 0.0)
    nowhere = (still & (c >= 0.0)) | (b * b - a * c <= 0.0) & ~still
    low = np.where(everywhere, -np.inf, np.where(nowhere, np.inf, low))
    high = np.where(everywhere, np.inf, np.where(nowhere, -np.inf, high))
    return low, high


def _roots(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Both roots of a s^2 + 2 b s + c (complex ones: their real part), without cancellation."""
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    q = -(b + np.where(b < 0.0, -root, root))
    return _ratio(q, a), np.where(q == 0.0, _ratio(-b, a), _ratio(c, q))


def _ratio(above: Array, below: Array) -> Array:
    """The quotient; 0 for 0 / 0."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where((above == 0.0) & (below == 0.0), 0.0, above / below)
