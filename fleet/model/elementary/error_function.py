"""The complementary error function (fdlibm): what bit errors in white noise are reckoned with."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fleet.model.elementary.both import for_both
from fleet.model.elementary.exponential import exp
from fleet.model.elementary.inverse import upper_half

ERF_1 = 8.45062911510467529297e-01
"""erf(1) in 24 bits."""

Rational = tuple[Sequence[float], Sequence[float]]
"""Coefficients of a polynomial and of that by which it is divided, the highest first."""

NEAR_0: Rational = (
    (
        -2.37630166566501626084e-05,
        -5.77027029648944159157e-03,
        -2.84817495755985104766e-02,
        -3.25042107247001499370e-01,
        1.28379167095512558561e-01,
    ),
    (
        -3.96022827877536812320e-06,
        1.32494738004321644526e-04,
        5.08130628187576562776e-03,
        6.50222499887672944485e-02,
        3.97917223959155352819e-01,
        1.0,
    ),
)
NEAR_1: Rational = (
    (
        -2.16637559486879084300e-03,
        3.54783043256182359371e-02,
        -1.10894694282396677476e-01,
        3.18346619901161753674e-01,
        -3.72207876035701323847e-01,
        4.14856118683748331666e-01,
        -2.36211856075265944077e-03,
    ),
    (
        1.19844998467991074170e-02,
        1.36370839120290507362e-02,
        1.26171219808761642112e-01,
        7.18286544141962662868e-02,
        5.40397917702171048937e-01,
        1.06420880400844228286e-01,
        1.0,
    ),
)
FROM_1: Rational = (
    (
        -9.81432934416914548592e00,
        -8.12874355063065934246e01,
        -1.84605092906711035994e02,
        -1.62396669462573470355e02,
        -6.23753324503260060396e01,
        -1.05586262253232909814e01,
        -6.93858572707181764372e-01,
        -9.86494403484714822705e-03,
    ),
    (
        -6.04244152148580987438e-02,
        6.57024977031928170135e00,
        1.08635005541779435134e02,
        4.29008140027567833386e02,
        6.45387271733267880336e02,
        4.34565877475229228821e02,
        1.37657754143519042600e02,
        1.96512716674392571292e01,
        1.0,
    ),
)
FROM_3: Rational = (
    (
        -4.83519191608651397019e02,
        -1.02509513161107724954e03,
        -6.37566443368389627722e02,
        -1.60636384855821916062e02,
        -1.77579549177547519889e01,
        -7.99283237680523006574e-01,
        -9.86494292470009928597e-03,
    ),
    (
        -2.24409524465858183362e01,
        4.74528541206955367215e02,
        2.55305040643316442583e03,
        3.19985821950859553908e03,
        1.53672958608443695994e03,
        3.25792512996573918826e02,
        3.03380607434824582924e01,
        1.0,
    ),
)


def _quotient(rational: Rational, z: float) -> float:
    above, below = (_polynomial(coefficients, z) for coefficients in rational)
    return above / below


def _polynomial(coefficients: Sequence[float], z: float) -> float:
    out = 0.0
    for coefficient in coefficients:
        out = out * z + coefficient
    return out


def _erfc(x: float) -> float:
    """1 less the error function."""
    size = abs(x)
    if size < 0.84375:
        y = x * _quotient(NEAR_0, x * x)
        return 1.0 - (x + y) if x < 0.25 else 0.5 - (y + (x - 0.5))
    if size < 1.25:
        y = _quotient(NEAR_1, size - 1.0)
        return (1.0 - ERF_1) - y if x > 0.0 else 1.0 + (ERF_1 + y)
    if math.isnan(x):
        return x
    tail = _tail(size) if size < 28.0 else 0.0
    return tail if x > 0.0 else 2.0 - tail


def _tail(x: float) -> float:
    """erfc(x), 1.25 <= x < 28: exp(-x^2) as a product, since the square would lose digits."""
    more = _quotient(FROM_1 if x < 1.0 / 0.35 else FROM_3, 1.0 / (x * x))
    upper = upper_half(x)
    return exp(-upper * upper - 0.5625) * exp((upper - x) * (upper + x) + more) / x


erfc = for_both(_erfc)
