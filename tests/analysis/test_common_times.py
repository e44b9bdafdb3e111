"""True states of one moment, however late they come; and what numbers look like in words."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis.common_times import CommonTimes, positions_of
from fleet.analysis.separation import SeparationMonitor, nearness_of
from fleet.analysis.words import counted, separation_text, share_text, wilson
from fleet.model.conflict.risk import Required

TICK_NS = 100_000_000
IDS = (3, 5, 8)
REQUIRED = Required(400.0, 50.0)
State = tuple[int, int, tuple[float, float, float]]


def flown(seed: int, gaps: float) -> list[State]:
    """True states of three UAVs at 120 ticks, some of them missing; UAV 8 ends early."""
    rng = random.Random(seed)
    out = []
    for tick in range(120):
        for n, uav in enumerate(IDS):
            if rng.random() >= gaps and not (uav == 8 and tick > 70):
                place = (
                    10.0 * tick * (n - 1),
                    60.0 * n + rng.uniform(-5.0, 5.0),
                    -300.0 - 20.0 * n,
                )
                out.append((uav, tick * TICK_NS, place))
    return out


@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.1, 0.6]), st.integers(0, 40))
@settings(deadline=None, derandomize=True, max_examples=60)
def test_what_comes_late_is_measured_as_if_it_had_come_in_time(
    seed: int, gaps: float, late_ticks: int
) -> None:
    states = flown(seed, gaps)
    by_uav = {uav: {t: place for u, t, place in states if u == uav} for uav in IDS}
    times_ns, positions = positions_of(IDS, by_uav)
    whole = nearness_of(IDS, times_ns, positions, REQUIRED)

    delay = {uav: random.Random(seed + uav).uniform(0, late_ticks) * TICK_NS for uav in IDS}
    monitor, moments, handed = SeparationMonitor(IDS, REQUIRED), CommonTimes(IDS), []
    for uav, t_ns, place in sorted(states, key=lambda s: s[1] + delay[s[0]]):
        moments.add(uav, t_ns, place)
        for now_ns, there in moments.until(moments.settled_ns(frozenset())):
            monitor.update(now_ns, there)
            handed.append(now_ns)
    assert not handed or handed[-1] < times_ns[-1]
    for now_ns, there in moments.rest():
        monitor.update(now_ns, there)
        handed.append(now_ns)
    assert handed == times_ns.tolist()
    assert monitor.minima() == whole.minima


def test_a_gap_is_flown_in_a_straight_line_and_an_end_is_an_end() -> None:
    places = {0: (0.0, 0.0, 0.0), 4 * TICK_NS: (8.0, 4.0, -4.0)}
    other = {n * TICK_NS: (0.0, 0.0, 0.0) for n in range(6)}
    _, positions = positions_of((1, 2), {1: places, 2: other})
    assert positions[0, :5].tolist() == [[2.0 * n, n, -float(n)] for n in range(5)]
    assert np.isnan(positions[0, 5]).all()


def test_who_has_vanished_is_not_waited_for() -> None:
    moments = CommonTimes((1, 2))
    for tick in range(100):
        moments.add(1, tick * TICK_NS, (0.0, 0.0, 0.0))
    assert list(moments.until(moments.settled_ns(frozenset()))) == []
    settled_ns = moments.settled_ns(frozenset({2}))
    assert settled_ns == 49 * TICK_NS
    assert len(list(moments.until(settled_ns))) == 50


def test_strangers_and_what_is_over_do_not_count() -> None:
    moments = CommonTimes((1,))
    moments.add(9, 0, (0.0, 0.0, 0.0))
    moments.add(1, 5, (0.0, 0.0, 0.0))
    assert [t for t, _ in moments.rest()] == [5]
    moments.add(1, 4, (0.0, 0.0, 0.0))
    assert list(moments.rest()) == []


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1.000"),
        (1.0004, "1.000"),
        (0.8, "0.800"),
        (0.79999999999, "0.800"),
        (0.9994, "0.999"),
        (0.9996, "0.9996"),
        (0.99996, "0.99996"),
        (0.99999999, "<1"),
        (np.nextafter(1.0, 0.0), "<1"),
        (float("inf"), "inf"),
    ],
)
def test_a_loss_never_reads_as_kept(value: float, text: str) -> None:
    assert separation_text(value) == text


def test_one_is_not_many() -> None:
    told = [counted(1, "pair"), counted(0, "pair"), counted(2, "loss", "losses")]
    assert told == ["1 pair", "0 pairs", "2 losses"]


@pytest.mark.parametrize(
    ("came", "of", "low", "high"),
    # Wilson's interval as published tables have it.
    [(14, 20, 0.4810, 0.8545), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (0, 0, 0.0, 1.0)],
)
def test_a_share_has_its_interval(came: int, of: int, low: float, high: float) -> None:
    assert wilson(came, of) == pytest.approx((low, high), abs=1e-4)


def test_a_share_in_words() -> None:
    assert share_text(14, 20) == "70.0 % (48.1 to 85.5)"
    assert share_text(0, 0) == "-"
