"""The rule that names the computing UAV."""

from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model.election import lowest_eligible

NOW_NS = 10_000_000_000
LIMIT_NS = 1_500_000_000

heard_maps = st.dictionaries(st.integers(1, 60), st.integers(0, NOW_NS), max_size=20)
member_sets = st.sets(st.integers(1, 60), max_size=20)
SETTINGS = settings(deadline=None, derandomize=True, max_examples=200)


def elect(members: list[int], last_heard_ns: dict[int, int]) -> int | None:
    return lowest_eligible(members, last_heard_ns, NOW_NS, LIMIT_NS)


def test_the_lowest_member_computes() -> None:
    assert elect([7, 3, 5], {3: NOW_NS, 5: NOW_NS, 7: NOW_NS}) == 3


def test_a_silent_member_is_passed_over() -> None:
    assert elect([3, 5, 7], {3: NOW_NS - LIMIT_NS - 1, 5: NOW_NS, 7: NOW_NS}) == 5


def test_a_member_silent_for_exactly_the_limit_is_still_eligible() -> None:
    assert elect([3, 5], {3: NOW_NS - LIMIT_NS, 5: NOW_NS}) == 3


def test_a_member_never_heard_is_passed_over() -> None:
    assert elect([3, 5], {5: NOW_NS}) == 5


def test_one_outside_the_group_is_never_elected() -> None:
    assert elect([3, 5], {1: NOW_NS, 3: NOW_NS, 5: NOW_NS}) == 3


def test_nobody_is_elected_when_nobody_is_eligible() -> None:
    assert elect([], {1: NOW_NS}) is None
    assert elect([3, 5], {}) is None
    assert elect([3, 5], {3: 0, 5: 0}) is None


@SETTINGS
@given(member_sets, heard_maps)
def test_the_elected_is_eligible_and_nobody_eligible_is_lower(
    members: set[int], heard: dict[int, int]
) -> None:
    recent = {uav for uav, t_ns in heard.items() if t_ns >= NOW_NS - LIMIT_NS}
    expected = sorted(members & recent)
    assert elect(list(members), heard) == (expected[0] if expected else None)


@SETTINGS
@given(member_sets, heard_maps, st.randoms(use_true_random=False))
def test_the_order_of_members_and_of_what_was_heard_does_not_matter(
    members: set[int], heard: dict[int, int], rng: random.Random
) -> None:
    shuffled = sorted(members)
    rng.shuffle(shuffled)
    items = list(heard.items())
    rng.shuffle(items)
    assert elect(shuffled, dict(items)) == elect(sorted(members), heard)
