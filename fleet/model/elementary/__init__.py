"""Elementary functions that give the same bits on every machine, for floats and for arrays.

Those of `math` and numpy come from the C library or from code for certain processors, and no two of
them round alike. These are computed from what IEEE 754 defines to the last bit (+ - * / and the
square root, and what needs no rounding), in a fixed order. They are named as in `math`, and treat
what is outside of the domain as it does, or as numpy does where they are given an array: a float
and each element of an array give the same bits.

Errors are below 1 unit in the last place (exp, log, asin, acos), 2 (sin, cos, atan2, hypot, expm1,
log1p, log10), 3 (tan) or 5 (erfc); `tests/model/test_elementary.py` holds that. Coefficients that
are not those of a series are those of Sun's fdlibm 5.3.
"""

from __future__ import annotations

from fleet.model.elementary.distances import dist, hypot
from fleet.model.elementary.error_function import erfc
from fleet.model.elementary.exponential import exp, expm1, log, log1p, log10
from fleet.model.elementary.inverse import acos, asin, atan2
from fleet.model.elementary.sums import ordered_mean, ordered_sum
from fleet.model.elementary.trigonometric import cos, sin, sincos, tan

__all__ = [
    "acos",
    "asin",
    "atan2",
    "cos",
    "dist",
    "erfc",
    "exp",
    "expm1",
    "hypot",
    "log",
    "log1p",
    "log10",
    "ordered_mean",
    "ordered_sum",
    "sin",
    "sincos",
    "tan",
]
