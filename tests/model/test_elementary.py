"""The elementary functions against multiprecision, and floats against arrays."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model import elementary as el
from fleet.model.elementary import inverse
from fleet.model.types import Array

SAMPLES = 500
TIGHT, LOOSE = 1.0, 2.0
SIGNS = (-1.0, 1.0)

Draw = Callable[[random.Random], float]


def between(low: float, high: float) -> Draw:
    return lambda rng: rng.uniform(low, high)


def sizes(low: float, high: float, *, signed: bool = True) -> Draw:
    """Numbers of all sizes between two powers of ten."""
    return lambda rng: 10.0 ** rng.uniform(low, high) * (rng.choice((-1.0, 1.0)) if signed else 1.0)


def near_one(rng: random.Random) -> float:
    return rng.choice(SIGNS) * (1.0 - float(10.0 ** rng.uniform(-16.0, -1.0)))


def near_quarters(rng: random.Random) -> float:
    """The floats that are nearest to multiples of pi / 2, where digits are lost."""
    nearest: float = float(rng.randint(-70, 70) * mpmath.pi / 2)
    return float(math.nextafter(nearest, rng.choice((-math.inf, nearest, math.inf)))) or 1.0


CASES: list[tuple[str, float, list[Draw]]] = [
    ("sin", LOOSE, [between(-6.5, 6.5), sizes(-300, 0), sizes(0, 308), near_quarters]),
    ("cos", LOOSE, [between(-6.5, 6.5), sizes(-300, 0), sizes(0, 308), near_quarters]),
    ("tan", 3.0, [between(-1.5, 1.5), sizes(-300, 0), sizes(0, 308)]),
    ("asin", TIGHT, [between(-1.0, 1.0), near_one, sizes(-300, -1)]),
    ("acos", TIGHT, [between(-1.0, 1.0), near_one]),
    ("exp", TIGHT, [between(-20.0, 20.0), between(-708.0, 709.7), sizes(-20, 2)]),
    ("expm1", LOOSE, [between(-3.0, 3.0), sizes(-20, 2.8)]),
    ("log", TIGHT, [between(0.1, 10.0), sizes(-320, 308, signed=False)]),
    ("log1p", LOOSE, [between(-0.99, 4.0), sizes(-320, 308, signed=False)]),
    ("log10", LOOSE, [sizes(-320, 308, signed=False)]),
    ("erfc", 5.0, [between(-6.0, 6.0), between(6.0, 26.0)]),
]
"""Function, greatest error in units in the last place, and where."""

FUNCTIONS = {name: getattr(el, name) for name, _, _ in CASES}


def error_ulp(value: float, exact: Any) -> float:
    return float(abs(mpmath.mpf(value) - exact) / math.ulp(float(exact)))


@pytest.mark.parametrize(("name", "most", "draws"), CASES)
def test_the_error_is_within_units_in_the_last_place(
    name: str, most: float, draws: Sequence[Draw]
) -> None:
    rng = random.Random(name)
    with mpmath.workprec(1300 if name in ("sin", "cos", "tan") else 200):
        for draw in draws:
            for _ in range(SAMPLES):
                x = draw(rng)
                exact = getattr(mpmath, name)(mpmath.mpf(x))
                assert error_ulp(FUNCTIONS[name](x), exact) < most, x


@pytest.mark.parametrize("exponent", [1.0, 9.0, 308.0])
def test_the_error_of_functions_of_two_is_too(exponent: float) -> None:
    rng, draw = random.Random(1), sizes(-exponent, exponent)
    with mpmath.workprec(300):
        for _ in range(SAMPLES):
            y, x, z = draw(rng), draw(rng), draw(rng)
            square = mpmath.mpf(x) ** 2 + mpmath.mpf(y) ** 2
            assert error_ulp(el.atan2(y, x), mpmath.atan2(y, x)) < LOOSE
            if math.hypot(x, y, z) < math.inf:
                assert error_ulp(el.hypot(x, y), mpmath.sqrt(square)) < LOOSE
                exact = mpmath.sqrt(square + mpmath.mpf(z) ** 2)
                assert error_ulp(el.hypot(x, y, z), exact) < LOOSE
                assert error_ulp(el.dist((x, y, z), (0.0, 0.0, 0.0)), exact) < LOOSE


def test_an_arc_tangent_that_is_its_argument_is_what_the_series_gives() -> None:
    rng, draw = random.Random(1), sizes(-300.0, -9.0)
    pairs = [(draw(rng), rng.uniform(1.0, 10.0)) for _ in range(SAMPLES)]
    short = [el.atan2(y, x) for y, x in pairs]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inverse, "NO_ARC", 0.0)
        assert short == [el.atan2(y, x) for y, x in pairs]


SPECIAL = (0.0, -0.0, 0.5, 1.0, -1.0, 2.0, -2.0, 800.0, -800.0, math.inf, -math.inf, math.nan)


def outcome(function: Callable[..., float], *args: float) -> str:
    try:
        return repr(function(*args))
    except (ValueError, OverflowError) as error:
        return type(error).__name__


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("x", [0.0, -0.0, math.inf, -math.inf, math.nan, *(1.0, -1.0, 2.0, 1e9)])
def test_the_odd_values_are_those_of_math(name: str, x: float) -> None:
    ours, theirs = (outcome(f, x) for f in (FUNCTIONS[name], getattr(math, name)))
    if theirs in ("ValueError", "OverflowError", "nan", "inf", "-inf", "0.0", "-0.0", "1.0"):
        assert ours == theirs
    else:
        assert float(ours) == pytest.approx(float(theirs))


@pytest.mark.parametrize("y", SPECIAL)
@pytest.mark.parametrize("x", SPECIAL)
def test_the_odd_values_of_two_are_those_of_math(y: float, x: float) -> None:
    assert outcome(el.hypot, x, y) == outcome(math.hypot, x, y)
    ours, theirs = el.atan2(y, x), math.atan2(y, x)
    assert ours == pytest.approx(theirs, nan_ok=True)
    assert math.copysign(1.0, ours) == math.copysign(1.0, theirs) or math.isnan(theirs)


def test_a_cache_does_not_take_the_zeros_for_one() -> None:
    assert [repr(el.sin(x)) for x in (0.0, -0.0, 0.0)] == ["0.0", "-0.0", "0.0"]
    assert [repr(el.atan2(y, -1.0)) for y in (0.0, -0.0)] == [f"{math.pi}", f"{-math.pi}"]
    assert [repr(el.atan2(0.0, x)) for x in (0.0, -0.0)] == ["0.0", f"{math.pi}"]


def test_other_numbers_are_taken_as_floats() -> None:
    assert el.sin(np.float64(0.5)) == el.sin(0.5)
    assert type(el.sin(np.float64(0.5))) is type(el.sincos(np.float64(0.5))[0]) is float
    assert el.exp(1) == el.exp(1.0)


def bits(values: Sequence[float]) -> bytes:
    """The bits of floats, of every NaN the same."""
    return b"".join(struct.pack("<d", math.nan if math.isnan(v) else v) for v in values)


def placed(values: Array, how: str) -> Array:
    """The same values elsewhere in memory."""
    if how == "every third":
        out = np.full(3 * len(values), math.nan)[::3]
    elif how == "backwards":
        out = np.empty(len(values))[::-1]
    elif how == "not aligned":
        out = np.frombuffer(bytearray(8 * len(values) + 1), dtype=np.uint8)[1:].view(np.float64)
    else:
        return values
    out[:] = values
    return out


def one_by_one(name: str, x: float) -> float:
    """What a float gives, where it raises as numpy tells it."""
    try:
        return float(FUNCTIONS[name](x))
    except ValueError:
        pole = {"log": 0.0, "log10": 0.0, "log1p": -1.0}.get(name)
        return -math.inf if x == pole else math.nan
    except OverflowError:
        return math.inf


numbers = st.floats() | st.floats(-7.0, 7.0) | st.floats(-1.0, 1.0) | st.sampled_from(SPECIAL)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    st.lists(numbers, min_size=1, max_size=50),
    st.sampled_from(["as they are", "every third", "backwards", "not aligned"]),
    st.integers(1, 3),
)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_floats_and_arrays_have_the_same_bits(
    name: str, values: list[float], how: str, times: int
) -> None:
    wanted = [one_by_one(name, x) for x in values] * times
    found = FUNCTIONS[name](placed(np.array(values * times), how))
    assert bits(found.tolist()) == bits(wanted)


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=100))
def test_lengths_of_floats_and_arrays_have_the_same_bits(pairs: list[tuple[float, float]]) -> None:
    table = np.array(pairs)
    wanted = [el.hypot(x, y) for x, y in pairs]
    with np.errstate(all="ignore"):
        assert bits(el.hypot(table[:, 0], table[:, 1]).tolist()) == bits(wanted)


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300))
def test_sine_and_cosine_are_also_had_together(values: list[float]) -> None:
    pairs = [el.sincos(x) for x in values]
    assert pairs == [(el.sin(x), el.cos(x)) for x in values]
    sines, cosines = el.sincos(np.array(values))
    assert list(zip(sines.tolist(), cosines.tolist(), strict=True)) == pairs


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=300))
def test_sums_are_made_in_order(values: list[float]) -> None:
    wanted = 0.0
    for value in values:
        wanted += value
    assert el.ordered_sum(np.array([values, values])).tolist() == [wanted, wanted]
    assert el.ordered_mean(np.array(values)) == wanted / len(values)


def test_the_shape_stays() -> None:
    x = np.linspace(-1.0, 1.0, 120).reshape(2, 3, 20)
    for function in FUNCTIONS.values():
        assert function(x).shape == x.shape
    assert el.sincos(x)[1].shape == x.shape
    assert el.sin(np.empty((0, 4))).shape == (0, 4)
