"""When participants step in realtime: apart from each other, whoever they are."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from fleet.protocol.phases import phase_ns

TICK_NS = 100_000_000


def test_a_phase_is_a_multiple_of_the_golden_ratio_modulo_one_of_three_quarters_of_a_tick() -> None:
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    told = [phase_ns(n, TICK_NS) for n in range(6)]
    due = [0.75 * TICK_NS * math.fmod(n * golden, 1.0) for n in range(6)]
    assert told[0] == 0
    assert all(abs(t - d) <= 1.0 for t, d in zip(told, due, strict=True))


@given(st.integers(0, 2**32), st.integers(1, 300), st.integers(1_000, 10**10))
def test_those_of_one_host_step_apart_from_each_other(first: int, count: int, tick_ns: int) -> None:
    """The gaps of n such points are no less than 0.38 of 1 / n, where equal ones were 1 / n."""
    phases = sorted(phase_ns(n, tick_ns) for n in range(first, first + count))
    assert phases[0] >= 0
    assert phases[-1] < Fraction(3, 4) * tick_ns
    gaps = [b - a for a, b in itertools.pairwise(phases)]
    assert min(gaps, default=tick_ns) >= 0.38 * 0.75 * tick_ns / count - 1
