"""Numbers of UAVs as people write them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.config.uav_numbers import numbers_in, ranges_of


@pytest.mark.parametrize(
    ("text", "numbers"),
    [("3", [3]), ("1-4", [1, 2, 3, 4]), (" 5 , 1-2,2 ", [5, 1, 2]), ("7-7", [7])],
)
def test_ranges_are_read(text: str, numbers: list[int]) -> None:
    assert numbers_in(text) == numbers


@pytest.mark.parametrize("text", ["", "0", "4-1", "1-", "-3", "a", "1;2", "1-20000", "1,,2", "²"])
def test_what_is_no_list_of_numbers_is_told_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match="IDs from 1, as in 1-8 or 1,2,30-40"):
        numbers_in(text)


@given(st.sets(st.integers(1, 60), min_size=1))
def test_what_is_written_is_read_again(numbers: set[int]) -> None:
    assert numbers_in(ranges_of(numbers)) == sorted(numbers)


def test_they_are_written_as_short_as_can_be() -> None:
    assert ranges_of([9, 1, 2, 3, 5, 6]) == "1-3, 5, 6, 9"
