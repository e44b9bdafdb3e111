"""Arc sine, arc cosine and arc tangent (fdlibm)."""

from __future__ import annotations

import math

import numpy as np

from fleet.model.elementary.both import Real, elsewhere, for_both
from fleet.model.types import Array

PIO2, PIO2_REST = 1.57079632679489655800, 6.12323399573676603587e-17
"""pi / 2 as a sum."""

PIO4 = 0.5 * PIO2

SPLIT = 134217729.0
"""2^27 + 1: takes the upper half of the digits of a number (Veltkamp)."""

NEARLY_ZERO = 1e-300
"""Added to what is never so small unless it is 0."""

NO_ARC = 1e-9
"""The arc tangent of what is less is the same float."""

ATAN_HALF = 4.63647609000806093515e-01, 2.26987774529616870924e-17
ATAN_1 = 7.85398163397448278999e-01, 3.06161699786838301793e-17
ATAN_3_HALVES = 9.82793723247329054082e-01, 1.39033110312309984516e-17
"""Arc tangents as sums."""


def _beyond(z: Real) -> Real:
    """(arcsin x - x) / x as a function of z = x^2, |x| <= 0.5."""
    p = z * (
        1.66666666666666657415e-01
        + z
        * (
            -3.25565818622400915405e-01
            + z
            * (
                2.01212532134862925881e-01
                + z
                * (
                    -4.00555345006794114027e-02
                    + z * (7.91534994289814532176e-04 + z * 3.47933107596021167570e-05)
                )
            )
        )
    )
    q = 1.0 + z * (
        -2.40339491173441421878e00
        + z
        * (
            2.02094576023350569471e00
            + z * (-6.88283971605453293030e-01 + z * 7.70381505559019352791e-02)
        )
    )
    return p / q


def upper_half(x: Real) -> Real:
    """The upper 26 bits of a number."""
    t = x * SPLIT
    return t - (t - x)


def _near_one(z: Real, root: Real) -> Real:
    """Arcsin x of x >= 0.5, given z = (1 - x) / 2 and its root."""
    upper = upper_half(root)
    lower = (z - upper * upper) / (root + upper + NEARLY_ZERO)
    more = 2.0 * root * _beyond(z)
    return PIO4 - ((more - (PIO2_REST - 2.0 * lower)) - (PIO4 - 2.0 * upper))


def _asin(x: float) -> float:
    """Arc sine, in radians."""
    size = abs(x)
    if size < 0.5:
        return x + x * _beyond(x * x)
    if not size <= 1.0:
        return _outside(x)
    z = 0.5 * (1.0 - size)
    return math.copysign(_near_one(z, math.sqrt(z)), x)


def _asins(x: Array) -> Array:
    size = np.abs(x)
    small = size < 0.5
    low = np.where(small, x, 0.0)
    out: Array = low + low * _beyond(low * low)
    if not small.all():
        z = 0.5 * (1.0 - np.where(small, 0.5, size))
        out = np.where(small, out, np.copysign(_near_one(z, np.sqrt(z)), x))
    return out


def _acos(x: float) -> float:
    """Arc cosine, in radians."""
    if -0.5 < x < 0.5:
        return PIO2 - (x - (PIO2_REST - x * _beyond(x * x)))
    if not -1.0 <= x <= 1.0:
        return _outside(x)
    if x < 0.0:
        z = 0.5 * (1.0 + x)
        root = math.sqrt(z)
        return 2.0 * PIO2 - 2.0 * (root + (_beyond(z) * root - PIO2_REST))
    z = 0.5 * (1.0 - x)
    root = math.sqrt(z)
    upper = upper_half(root)
    lower = (z - upper * upper) / (root + upper + NEARLY_ZERO)
    return 2.0 * (upper + (_beyond(z) * root + lower))


def _outside(x: float) -> float:
    if math.isnan(x):
        return x
    raise ValueError("math domain error")


def _arc(y: float, x: float) -> float:
    """Arc tangent of y / x, both positive."""
    t = y / x
    if t < NO_ARC:
        return t
    if t < 0.4375:
        u, (angle, rest) = t, (0.0, 0.0)
    elif t < 0.6875:
        u, (angle, rest) = (2.0 * t - 1.0) / (2.0 + t), ATAN_HALF
    elif t < 1.1875:
        u, (angle, rest) = (t - 1.0) / (t + 1.0), ATAN_1
    elif t < 2.4375:
        u, (angle, rest) = (t - 1.5) / (1.0 + 1.5 * t), ATAN_3_HALVES
    else:
        u, (angle, rest) = -x / y, (PIO2, PIO2_REST)
    z = u * u
    w = z * z
    odd = z * (
        3.33333333333329318027e-01
        + w
        * (
            1.42857142725034663711e-01
            + w
            * (
                9.09088713343650656196e-02
                + w
                * (
                    6.66107313738753120669e-02
                    + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)
                )
            )
        )
    )
    even = w * (
        -1.99999999998764832476e-01
        + w
        * (
            -1.11111104054623557880e-01
            + w
            * (
                -7.69187620504482999495e-02
                + w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02)
            )
        )
    )
    return angle - ((u * (odd + even) - rest) - u)


def atan2(y: float, x: float) -> float:
    """Angle of the vector (x, y), in radians; of floats alone."""
    if not (x and y and -math.inf < y < math.inf and -math.inf < x < math.inf):
        return _on_axis(y, x)
    arc = _arc(float(abs(y)), float(abs(x)))
    if x < 0.0:
        arc = 2.0 * PIO2 - (arc - 2.0 * PIO2_REST)
    return arc if y > 0.0 else -arc


def _on_axis(y: float, x: float) -> float:
    """Where one of both is 0, infinite or no number."""
    if math.isnan(x) or math.isnan(y):
        return math.nan
    if math.isinf(y) and math.isinf(x):
        eighths = 1.0 if x > 0.0 else 3.0
    elif y == 0.0 or math.isinf(x):
        eighths = 0.0 if math.copysign(1.0, x) > 0.0 else 4.0
    else:
        eighths = 2.0
    return math.copysign(eighths * PIO4, y)


asin = for_both(_asin, lambda x: elsewhere(_asin, _asins, x, np.abs(x) <= 1.0))
acos = for_both(_acos)
