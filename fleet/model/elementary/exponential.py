"""Exponential function and logarithm (fdlibm).

exp: x = k ln 2 + r with |r| <= ln 2 / 2, and exp(r) = 1 + r + r c / (2 - c), c being r less a
polynomial. log: x = 2^k (1 + f) with 1 + f about 1, and a polynomial in f / (2 + f).
"""

from __future__ import annotations

import math

import numpy as np

from fleet.model.elementary.both import TO_NEAREST, Real, elsewhere, for_both
from fleet.model.types import Array

LN2_1, LN2_2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10
"""ln 2 as a sum; products of the first, of 33 bits, with small integers are exact."""

LN2_INVERSE = 1.44269504088896338700
LOG10_E_1, LOG10_E_2 = 0.4342944819032518, 1.098319650216765e-17
"""log10 e as a sum."""

SQRT_HALF = 0.7071067811865476
USUAL = 700.0
"""Within this exponents need no care."""


def _without_powers(x: Real, k: Real) -> tuple[Real, Real, Real]:
    """R = x - k ln 2 as a difference of two, and exp(r) less 1 + r."""
    high, low = x - k * LN2_1, k * LN2_2
    r = high - low
    z = r * r
    c = r - z * (
        1.66666666666666019037e-01
        + z
        * (
            -2.77777777770155933842e-03
            + z
            * (
                6.61375632143793436117e-05
                + z * (-1.65339022054652515390e-06 + z * 4.13813679705723846039e-08)
            )
        )
    )
    return high, low, r * c / (2.0 - c)


def _exp(x: float) -> float:
    """E to the power of x."""
    if not -USUAL <= x <= USUAL:
        if x > 709.782712893384:
            if x == math.inf:
                return x
            raise OverflowError("math range error")
        if x < -745.1332191019411:
            return 0.0
        if math.isnan(x):
            return x
    k = (x * LN2_INVERSE + TO_NEAREST) - TO_NEAREST
    high, low, more = _without_powers(x, k)
    return math.ldexp(1.0 - ((low - more) - high), int(k))


def _exps(x: Array) -> Array:
    k = np.rint(x * LN2_INVERSE)
    high, low, more = _without_powers(x, k)
    return np.ldexp(1.0 - ((low - more) - high), k.astype(np.int64))


def _expm1(x: float) -> float:
    """E to the power of x, less 1: exact also where that is little."""
    if x < -40.0:
        return -1.0
    if x > USUAL or math.isnan(x) or x == 0.0:
        return _exp(x) if x else x
    k = (x * LN2_INVERSE + TO_NEAREST) - TO_NEAREST
    high, low, more = _without_powers(x, k)
    one = 1.0 - math.ldexp(1.0, -int(k))
    return math.ldexp((one + high) - (low - more), int(k))


def _log_near_one(f: Real, k: Real, rest: Real | float = 0.0) -> Real:
    """log(2^k (1 + f)) + rest, -0.3 < f < 0.42."""
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (
        3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01)
    )
    odd = z * (
        6.666666666666735130e-01
        + w
        * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half = 0.5 * f * f
    return k * LN2_1 - ((half - (s * (half + (odd + even)) + (k * LN2_2 + rest))) - f)


def _log(x: float) -> float:
    """Natural logarithm."""
    if x <= 0.0:
        raise ValueError("math domain error")
    if not x < math.inf:
        return x
    m, k = math.frexp(x)
    if m < SQRT_HALF:
        m, k = 2.0 * m, k - 1
    return _log_near_one(m - 1.0, float(k))


def _logs(x: Array) -> Array:
    m, k = np.frexp(x)
    low = m < SQRT_HALF
    return _log_near_one(np.where(low, 2.0 * m, m) - 1.0, np.where(low, k - 1.0, k))


def _log1p(x: float) -> float:
    """Natural logarithm of 1 + x: exact also where x is little."""
    if x <= -1.0:
        raise ValueError("math domain error")
    if x == 0.0 or not x < math.inf:
        return x
    if -0.29 < x < 0.41:
        return _log_near_one(x, 0.0)
    y = 1.0 + x
    lost = 1.0 - (y - x) if x > 1.0 else x - (y - 1.0)
    m, k = math.frexp(y)
    if m < SQRT_HALF:
        m, k = 2.0 * m, k - 1
    return _log_near_one(m - 1.0, float(k), lost / y)


def _log10(x: float) -> float:
    """Logarithm to base 10."""
    y = _log(x)
    return y * LOG10_E_1 + y * LOG10_E_2 if y < math.inf else y


def _log_or_pole(x: float) -> float:
    return -math.inf if x == 0.0 else _log(x)


exp = for_both(_exp, lambda x: elsewhere(_exp, _exps, x, np.abs(x) <= USUAL))
expm1 = for_both(_expm1)
log = for_both(
    _log,
    lambda x: elsewhere(_log_or_pole, _logs, x, (x > 0.0) & (x < math.inf)),
    pole=0.0,
)
log1p = for_both(_log1p, pole=-1.0)
log10 = for_both(_log10, pole=0.0)
