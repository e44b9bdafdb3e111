"""Sine, cosine and tangent.

The circle has `STEPS` steps, of which sine and cosine are in a table. An angle is a number of steps
and a rest of half a step at most, taken with more digits than a float has; of the rest a short
series is enough, and the angles are added.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import Protocol, cast, overload

import numpy as np

from fleet.model.elementary.both import CACHED, FEW_ELEMENTS, TO_NEAREST, Real, for_both
from fleet.model.types import Array


class SineAndCosine(Protocol):
    """A function of a float, or of an array, with two values."""

    @overload
    def __call__(self, x: float, /) -> tuple[float, float]: ...
    @overload
    def __call__(self, x: Array, /) -> tuple[Array, Array]: ...


STEPS = 128
A_QUARTER = STEPS // 4

STEPS_PER_RAD = 20.371832715762604
"""Nearest float to `STEPS` / 2 pi."""

STEP_1, STEP_2, STEP_3 = (
    1.57079632673412561417e00 / A_QUARTER,
    6.07710050630396597660e-11 / A_QUARTER,
    2.02226624879595063154e-21 / A_QUARTER,
)
"""A step in radians as a sum: of the first two, of 33 bits, products with small integers are exact.

Times a quarter of a circle they are the parts of pi / 2 of fdlibm.
"""

NEAR_RAD = 100.0
"""Up to here that sum is exact enough."""

FRACTION_BITS = 1216
"""So many bits after the point are enough for the greatest float."""


def _without_steps(x: Real, count: Real) -> Real:
    """An angle less so many steps."""
    first = x - count * STEP_1
    step = count * STEP_2
    near = first - step
    return near - (count * STEP_3 - ((first - near) - step))


def _together(sine: Real, cosine: Real, r: Real) -> tuple[Real, Real]:
    """Sine and cosine of an angle, given its sine and cosine, and of |r| < 0.025 more."""
    z = r * r
    s = r + z * r * (-1.0 / 6.0 + z * (1.0 / 120.0 - z * (1.0 / 5040.0)))
    less = z * z * (1.0 / 24.0 - z * (1.0 / 720.0)) - 0.5 * z
    return sine + (cosine * s + sine * less), cosine + (cosine * less - sine * s)


@cache
def _quarter() -> int:
    """Pi / 2 times 2^FRACTION_BITS, by Machin's formula."""
    one = 1 << (FRACTION_BITS + 64)

    def atan_of_inverse(n: int) -> int:
        term, out, k = one // n, 0, 1
        while term:
            out += term // k if k % 4 == 1 else -(term // k)
            term //= n * n
            k += 2
        return out

    return (2 * (4 * atan_of_inverse(5) - atan_of_inverse(239))) >> 64


def _sine(step: int) -> float:
    """Sine of so many steps, at most a quarter of a circle, correctly rounded."""
    bits = 160
    angle = (_quarter() * step // A_QUARTER) >> (FRACTION_BITS - bits)
    term, out, k = angle, 0, 1
    while term:
        out += term
        term = -((term * angle >> bits) * angle >> bits) // ((k + 1) * (k + 2))
        k += 2
    return out / (1 << bits)


RISING = [-0.0, *map(_sine, range(1, A_QUARTER + 1))]
HALF = [*RISING, *RISING[-2:0:-1]]
SINES = [*HALF, *[-s for s in HALF]]
"""The negative zero is for sin(-0.0), which is made by adding to it."""

COSINES = SINES[A_QUARTER:] + SINES[:A_QUARTER]
SINE_TABLE, COSINE_TABLE = np.array(SINES), np.array(COSINES)


def _far(x: float) -> tuple[int, float]:
    """The nearest number of steps, and what is left, of any finite angle."""
    numerator, denominator = abs(x).as_integer_ratio()
    quarter = _quarter()
    whole = (numerator << FRACTION_BITS) * A_QUARTER // denominator
    count, left = divmod(whole, quarter)
    if 2 * left > quarter:
        count, left = count + 1, left - quarter
    r = left / (A_QUARTER << FRACTION_BITS)
    return (count, r) if x > 0.0 else (-count, -r)


@lru_cache(maxsize=CACHED)
def _sincos(x: float) -> tuple[float, float]:
    """Both of an angle other than 0: a cache takes both zeros for one."""
    if -NEAR_RAD <= x <= NEAR_RAD:
        count = (x * STEPS_PER_RAD + TO_NEAREST) - TO_NEAREST
        step, r = int(count) % STEPS, _without_steps(x, count)
    elif math.isfinite(x):
        steps, r = _far(x)
        step = steps % STEPS
    elif math.isnan(x):
        return x, x
    else:
        raise ValueError("math domain error")
    return _together(SINES[step], COSINES[step], r)


def _sine_and_cosine(x: float | Array) -> tuple[float | Array, float | Array]:
    """Sine and cosine of an angle, cheaper than one after the other."""
    if type(x) is float:
        return _sincos(x) if x else (x, 1.0)
    return _sincos_of(x) if isinstance(x, np.ndarray) else _sine_and_cosine(float(x))


def _sin(x: float) -> float:
    """Sine of an angle in radians."""
    return _sincos(x)[0] if x else x


def _cos(x: float) -> float:
    """Cosine of an angle in radians."""
    return _sincos(x)[1]


def _tan(x: float) -> float:
    """Tangent of an angle in radians."""
    return _sin(x) / _cos(x)


def _sincos_of(x: Array) -> tuple[Array, Array]:
    if x.size <= FEW_ELEMENTS:
        return _one_by_one(x)
    near = np.abs(x) <= NEAR_RAD
    usual = bool(near.all())
    angle = x if usual else np.where(near, x, 0.0)
    count = (angle * STEPS_PER_RAD + TO_NEAREST) - TO_NEAREST
    step = count.astype(np.int64) & (STEPS - 1)
    r = _without_steps(angle, count)
    sine, cosine = _together(SINE_TABLE[step], COSINE_TABLE[step], r)
    if not usual:
        sine[~near], cosine[~near] = _one_by_one(x[~near])
    return sine, cosine


def _one_by_one(x: Array) -> tuple[Array, Array]:
    values = x.ravel().tolist()
    if math.inf in values or -math.inf in values:
        values = [math.nan if math.isinf(v) else v for v in values]
    flat: list[float] = []
    for value in values:
        flat += _sincos(value) if value else (value, 1.0)
    table = np.array(flat, dtype=np.float64).reshape(*x.shape, 2)
    return table[..., 0], table[..., 1]


sincos = cast("SineAndCosine", _sine_and_cosine)
sin = for_both(_sin, lambda x: _sincos_of(x)[0])
cos = for_both(_cos, lambda x: _sincos_of(x)[1])
tan = for_both(_tan)
