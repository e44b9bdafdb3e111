"""How a function of floats is also one of arrays."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import Array

Real = TypeVar("Real", float, Array)
"""A float or an array: what arithmetic is written for once."""

FEW_ELEMENTS = 32
"""So many elements are done faster one by one."""


TO_NEAREST = 6755399441055744.0
"""1.5 * 2^52: adding and subtracting it rounds to the nearest integer, half to even."""

CACHED = 4096
"""So many angles are remembered: a straight flight asks for the same again and again."""


class Elementary(Protocol):
    """A function of a float or, element by element, of an array."""

    @overload
    def __call__(self, x: float, /) -> float: ...
    @overload
    def __call__(self, x: Array, /) -> Array: ...


def for_both(
    one: Callable[[float], float],
    many: Callable[[Array], Array] | None = None,
    *,
    pole: float = math.nan,
) -> Elementary:
    """A function of both from that of a float, and from that of an array where there is one.

    At its pole, an array has the negative infinity.
    """

    def element(x: float) -> float:
        return -math.inf if x == pole else one(x)

    each = one if math.isnan(pole) else element

    def both(x: float | Array) -> float | Array:
        if type(x) is float:
            return one(x)
        if not isinstance(x, np.ndarray):
            return one(float(x))
        return one_by_one(each, x) if many is None or x.size <= FEW_ELEMENTS else many(x)

    both.__doc__ = one.__doc__
    return both  # type: ignore[return-value]


def one_by_one(one: Callable[[float], float], x: Array) -> Array:
    """Each element of an array; NaN and infinity where a float raises."""
    floats = x.ravel().tolist()
    try:
        values = [one(v) for v in floats]
    except (ValueError, OverflowError):
        values = [_as_numpy(one, v) for v in floats]
    return np.array(values, dtype=np.float64).reshape(x.shape)


def elsewhere(
    one: Callable[[float], float],
    many: Callable[[Array], Array],
    x: Array,
    usual: NDArray[np.bool_],
) -> Array:
    """`many` where an element is usual, and `one` for the rest of them."""
    if usual.all():
        return many(x)
    out = many(np.where(usual, x, 0.5))
    out[~usual] = one_by_one(one, x[~usual])
    return out


def _as_numpy(one: Callable[[float], float], x: float) -> float:
    try:
        return one(x)
    except ValueError:
        return math.nan
    except OverflowError:
        return math.inf
