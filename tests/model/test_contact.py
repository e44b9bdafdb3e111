"""Contact: after how long a silence means something, on clean and on lossy links."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model.conflict.contact import INCARNATION, STRETCH, WINDOW, Contact

MS = 1_000_000
CLEAN_NS = 1500 * MS
PERIOD_NS = 200 * MS
fast = settings(deadline=None, derandomize=True, max_examples=100)


def contact(*seqs: int) -> Contact:
    """One that heard these, each as it was sent."""
    made = Contact(CLEAN_NS, PERIOD_NS, seqs[0], seqs[0] * PERIOD_NS)
    for seq in seqs[1:]:
        made.hear(seq, seq * PERIOD_NS)
    return made


def test_without_loss_the_limit_is_the_plain_one() -> None:
    made = contact(*range(100))
    assert made.limit_ns == CLEAN_NS
    assert made.share == 1.0
    assert not made.silent(99 * PERIOD_NS + CLEAN_NS)
    assert made.silent(99 * PERIOD_NS + CLEAN_NS + 1)


@pytest.mark.parametrize(
    ("every", "came", "lost_in_a_row"),
    [
        (2, 16, 10),  # (1/2)^10 < 1/1000 < (1/2)^9
        (3, 11, 17),  # (21/32)^17 < 1/1000 < (21/32)^16
        (4, 8, 25),  # (24/32)^25 < 1/1000 < (24/32)^24
        (5, 7, 28),  # (25/32)^28 < 1/1000 < (25/32)^27
    ],
)
def test_the_limit_is_what_is_lost_in_a_row_one_time_in_a_thousand(
    every: int, came: int, lost_in_a_row: int
) -> None:
    """Every second, third ... message comes: so many of the last 32."""
    made = contact(*range(0, 50 * every, every))
    assert made.share == came / WINDOW
    assert made.limit_ns == lost_in_a_row * PERIOD_NS


def test_the_limit_is_never_below_the_plain_one_and_at_most_four_times_that() -> None:
    assert contact(*(n for n in range(99) if n % 3)).limit_ns == CLEAN_NS
    assert STRETCH == 4
    assert contact(*range(0, 700, 7)).limit_ns == 4 * CLEAN_NS  # 5 of 32 came: 41 in a row, 8.2 s


@pytest.mark.parametrize("loss", [0.3, 0.5, 0.8])
def test_few_silences_of_the_living_are_longer_than_the_limit(loss: float) -> None:
    rng = random.Random(1)
    came = [n for n in range(20_000) if rng.random() >= loss]
    made = Contact(CLEAN_NS, PERIOD_NS, came[0], came[0] * PERIOD_NS)
    false = plain = 0
    for seq in came[1:]:
        now_ns = seq * PERIOD_NS
        false += made.silent(now_ns)
        plain += now_ns - made.last_ns > CLEAN_NS
        made.hear(seq, now_ns)
    assert false <= 0.01 * len(came)
    assert loss < 0.8 or plain > 0.15 * len(came), "with the plain limit it is one in six"


def test_an_outage_counts_as_what_is_lost_within_the_plain_limit() -> None:
    made = contact(*range(40), 400)
    assert (made.share, made.limit_ns) == (25 / 32, CLEAN_NS)  # 7 broadcasts in 1.5 s


def test_at_first_a_link_is_taken_to_be_clean() -> None:
    assert contact(0, 4).limit_ns == contact(7).limit_ns == CLEAN_NS


def test_who_is_started_again_has_lost_nothing_by_that() -> None:
    made = contact(*range(40))
    made.hear(INCARNATION, 45 * PERIOD_NS)
    assert (made.share, made.limit_ns) == (1.0, CLEAN_NS)


@given(st.lists(st.integers(1, 40), max_size=80))
@fast
def test_the_limit_is_always_within_its_bounds(steps: list[int]) -> None:
    made, seq = contact(0), 0
    for step in steps:
        seq += step
        made.hear(seq, seq * PERIOD_NS)
        assert CLEAN_NS <= made.limit_ns <= STRETCH * CLEAN_NS
        assert 0.0 < made.share <= 1.0
        assert not made.silent(seq * PERIOD_NS)
