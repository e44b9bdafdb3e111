"""Conditions on common encounters: ratio, difference, induced and unresolved, McNemar and Holm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.errors import ArgumentError
from fleet.study.statistics.mcnemar import compare_conditions, mcnemar_p_value
from fleet.study.statistics.paired import (
    PairedCounts,
    effect_of_avoidance,
    risk_difference,
    risk_ratio,
)

CAVO = PairedCounts(59, 6, 16, 80)
"""Complete response before and after therapy: Fagerland, Lydersen and Laake (2014), example 2."""


def test_the_risk_ratio_is_that_of_the_textbook() -> None:
    found = risk_ratio(CAVO)
    assert found.value == pytest.approx(65 / 75)
    assert (round(found.low, 3), round(found.high, 3)) == (0.758, 0.991)


def test_the_risk_difference_is_that_of_the_textbook() -> None:
    found = risk_difference(CAVO)
    assert found.value == pytest.approx(-10 / 161)
    assert (round(found.low, 4), round(found.high, 4)) == (-0.1186, -0.0046)


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        # Newcombe 1998 (paired), table III, method 10: 36/50, 12/2 and the other way; none; all.
        (PairedCounts(36, 12, 2, 0), (0.0569, 0.3404)),
        (PairedCounts(0, 0, 0, 30), (-0.1135, 0.1135)),
        (PairedCounts(30, 0, 0, 0), (-0.1135, 0.1135)),
        (PairedCounts(0, 30, 0, 0), (0.8395, 1.0)),
    ],
)
def test_differences_of_few_or_none_are_those_of_newcombe(
    counts: PairedCounts, expected: tuple[float, float]
) -> None:
    found = risk_difference(counts)
    assert (found.low, found.high) == pytest.approx(expected, abs=6e-5)


def test_a_ratio_of_nothing_is_bounded_on_the_side_that_is_known() -> None:
    none_with = risk_ratio(PairedCounts(0, 0, 40, 60))
    assert (none_with.value, none_with.low) == (0.0, 0.0)
    assert 0.05 < none_with.high < 0.15
    none_without = risk_ratio(PairedCounts(0, 8, 0, 92))
    assert (none_without.value, none_without.high) == (math.inf, math.inf)
    assert none_without.low > 1
    none = risk_ratio(PairedCounts(0, 0, 0, 100))
    assert math.isnan(none.value)
    assert (none.low, none.high) == (0.0, math.inf)


@given(*[st.integers(0, 60)] * 4)
def test_with_and_without_exchanged_the_ratio_is_the_inverse(
    a: int, b: int, c: int, d: int
) -> None:
    if a + b + c == 0:
        return
    one, other = risk_ratio(PairedCounts(a, b, c, d)), risk_ratio(PairedCounts(a, c, b, d))
    assert one.low <= one.value <= one.high
    for low, high in ((one.low, other.high), (other.low, one.high)):
        assert low == pytest.approx(1 / high if high else math.inf, rel=1e-9)


def test_losses_with_avoidance_are_induced_or_unresolved() -> None:
    with_avoidance = np.array([True, True, False, False, False, True, False, False])
    without = np.array([True, False, True, True, True, True, True, False])
    effect = effect_of_avoidance(with_avoidance, without)
    assert effect.counts == PairedCounts(2, 1, 4, 1)
    assert (effect.lost_with.value, effect.lost_without.value) == (3 / 8, 6 / 8)
    assert (effect.induced.value, effect.unresolved.value) == (1 / 8, 2 / 8)
    assert effect.ratio.value == pytest.approx(0.5)
    assert effect.difference.value == pytest.approx(-3 / 8)
    assert effect.induced.method == "exact"
    with pytest.raises(ArgumentError, match="same encounters twice, not 8 and 7"):
        effect_of_avoidance(with_avoidance, without[1:])
    with pytest.raises(ArgumentError, match="true or false"):
        effect_of_avoidance([0.5, 1], [1, 1])


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        (CAVO, 0.052479),  # Fagerland, Lydersen and Laake
        (PairedCounts(101, 121, 59, 33), 4.434e-6),
        (PairedCounts(0, 0, 6, 0), 2 / 64),
        (PairedCounts(5, 0, 0, 9), 1.0),
        (PairedCounts(0, 4, 4, 0), 1.0),
    ],
)
def test_mcnemar_is_the_binomial_test_of_who_differs(counts: PairedCounts, expected: float) -> None:
    smaller, several = sorted((counts.first_only, counts.second_only))
    exact = sum(math.comb(smaller + several, k) for k in range(smaller + 1)) / 2 ** (
        smaller + several - 1
    )
    assert mcnemar_p_value(counts) == pytest.approx(min(1.0, exact), rel=1e-9)
    assert mcnemar_p_value(counts) == pytest.approx(expected, rel=0.01)


def outcome(lost: int, of: int = 12) -> list[bool]:
    return [k < lost for k in range(of)]


def test_holm_corrects_for_all_comparisons_made() -> None:
    outcomes = {"none": outcome(0), "some": outcome(6), "many": outcome(9)}
    found = {(test.first, test.second): test for test in compare_conditions(outcomes)}
    assert list(found) == [("none", "some"), ("none", "many"), ("some", "many")]
    # 2/2^6, 2/2^9, 2/2^3: the smallest by 3, the next by 2, the last as it is.
    assert [t.p_value for t in found.values()] == pytest.approx([2 / 64, 2 / 512, 2 / 8])
    assert [t.adjusted_p_value for t in found.values()] == pytest.approx([4 / 64, 6 / 512, 2 / 8])


def test_conditions_can_be_compared_with_one_alone() -> None:
    outcomes = {"none": outcome(0), "some": outcome(6), "many": outcome(9)}
    found = compare_conditions(outcomes, against="many")
    assert [(t.first, t.second) for t in found] == [("many", "none"), ("many", "some")]
    assert [t.adjusted_p_value for t in found] == pytest.approx([4 / 512, 2 / 8])
    assert found[0].counts == PairedCounts(0, 9, 0, 3)
    with pytest.raises(ArgumentError, match="'all' with none, some"):
        compare_conditions({"none": outcome(0), "some": outcome(1)}, against="all")
