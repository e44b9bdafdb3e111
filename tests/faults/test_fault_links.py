"""Link faults other than range: each does what it says, over many messages."""

from __future__ import annotations

import math
import statistics
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.faults.channel import Delivery, Fate
from fleet.faults.draws import LinkMessage
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.partition import Partition
from fleet.faults.kinds.rate import Rate
from fleet.faults.kinds.reorder import Reorder
from fleet.faults.kinds.replay import Replay
from fleet.faults.links import LinkRule
from tests.support.fault_samples import (
    MANY,
    TICK_NS,
    channel,
    fast,
    lost,
    stream,
    within_99_percent,
)


def fates(*rules: LinkRule, count: int = MANY) -> list[Fate]:
    found = channel(*rules)
    return [found.fate(link_message) for link_message in stream(count)]


moments_s = st.integers(0, 60).map(lambda n: n / 10)


@given(
    st.lists(st.tuples(moments_s, st.none() | moments_s, st.sampled_from("12*")), max_size=6),
    st.lists(st.tuples(moments_s, st.integers(1, 2)), min_size=1, max_size=30),
)
@fast
def test_rules_are_in_force_from_their_start_to_before_their_end_in_whatever_order_it_is_asked(
    windows: list[tuple[float, float | None, str]], asked: list[tuple[float, int]]
) -> None:
    found = channel(
        *(
            Latency(base_s=2.0**n, start_s=start_s, end_s=end_s, src=src)
            for n, (start_s, end_s, src) in enumerate(windows)
        )
    )
    for t_s, src in asked:
        message = LinkMessage(src, 3, "adsb", 0, round(t_s * 1e9), 800)
        delay_s = sum(
            2.0**n
            for n, (start_s, end_s, of) in enumerate(windows)
            if start_s <= t_s and (end_s is None or t_s < end_s) and of in ("*", str(src))
        )
        assert found.fate(message) == Fate((Delivery(round(delay_s * 1e9)),))


# loss, burst, partition


@pytest.mark.parametrize("probability", [0.1, 0.3, 0.5, 0.8])
def test_loss_is_within_its_99_percent_interval(probability: float) -> None:
    flags = lost(channel(Loss(probability=probability)), stream())
    assert within_99_percent(sum(flags) / MANY, probability)


def test_losses_on_two_links_are_independent() -> None:
    found = channel(Loss(probability=0.3))
    one, other = (lost(found, stream(dst=dst)) for dst in (2, 3))
    both = sum(a and b for a, b in zip(one, other, strict=True)) / MANY
    assert within_99_percent(both, 0.09)


def test_losses_by_two_rules_are_independent() -> None:
    twice = channel(Loss(probability=0.3), Loss(probability=0.3))
    assert within_99_percent(sum(lost(twice, stream())) / MANY, 1.0 - 0.7**2)


def test_what_a_low_loss_drops_a_higher_one_drops_too() -> None:
    dropped: list[set[int]] = []
    for probability in (0.0, 0.1, 0.3, 0.5, 0.8, 1.0):
        flags = lost(channel(Loss(probability=probability)), stream(20_000))
        dropped.append({n for n, gone in enumerate(flags) if gone})
    assert all(low < high for low, high in pairwise(dropped))
    assert (len(dropped[0]), len(dropped[-1])) == (0, 20_000)


@pytest.mark.parametrize(("loss", "mean_ticks"), [(0.1, 3.0), (0.3, 5.0), (0.5, 2.0)])
def test_bursts_have_their_loss_and_mean_length_within_5_percent(
    loss: float, mean_ticks: float
) -> None:
    flags = lost(channel(Burst(loss=loss, mean_ticks=mean_ticks)), stream(4 * MANY))
    bursts = [len(run) for run in "".join("x" if f else " " for f in flags).split()]
    assert sum(flags) / len(flags) == pytest.approx(loss, rel=0.05)
    assert statistics.mean(bursts) == pytest.approx(mean_ticks, rel=0.05)


def test_a_partition_passes_nothing_between_its_sides_while_it_lasts() -> None:
    found = channel(Partition(groups="1-2/3,coordinator", start_s=60.0, end_s=90.0))
    for src, dst in ((1, 3), (3, 2), (0, 1), (2, 0)):
        gone = lost(found, stream(1200, src, dst))
        assert [n for n, flag in enumerate(gone) if flag] == list(range(600, 900))
    for src, dst in ((1, 2), (0, 3), (4, 1), (3, 4)):
        assert not any(lost(found, stream(1200, src, dst)))


def test_a_partition_passes_none_of_many() -> None:
    found = channel(Partition(groups="1-100/200-300/coordinator"))
    crossing = ((1, 200), (100, 300), (250, 50), (0, 70), (222, 0))
    sent = [link_message for src, dst in crossing for link_message in stream(MANY // 5, src, dst)]
    assert sum(lost(found, sent)) == MANY


# latency, reorder, rate


def delays_s(rule: LinkRule) -> list[float]:
    return sorted(fate.deliveries[0].delay_ns / 1e9 for fate in fates(rule))


NORMAL = statistics.NormalDist()
QUANTILES: dict[str, Any] = {
    "uniform": lambda q: 1.0 + 0.2 * (2.0 * q - 1.0),
    "exponential": lambda q: 1.0 - 0.2 * math.log(1.0 - q),
    "lognormal": lambda q: 1.0 + 0.2 * math.exp(NORMAL.inv_cdf(q)),
}


@pytest.mark.parametrize("distribution", ["uniform", "exponential", "lognormal"])
def test_latency_quantiles_are_within_1_percent(distribution: Any) -> None:
    found = delays_s(Latency(base_s=1.0, jitter_s=0.2, distribution=distribution))
    for q in (0.05, 0.25, 0.5, 0.75, 0.95):
        assert found[round(q * (MANY - 1))] == pytest.approx(QUANTILES[distribution](q), rel=0.01)


def test_a_constant_latency_is_exact_and_a_cap_holds() -> None:
    assert set(delays_s(Latency(base_s=0.3, distribution="constant"))) == {0.3}
    capped = delays_s(Latency(base_s=0.3, jitter_s=1.0, distribution="exponential", cap_s=0.5))
    assert capped[-1] == 0.5
    assert min(delays_s(Latency(base_s=0.0, jitter_s=1.0))) == 0.0


def test_reordered_messages_are_overtaken() -> None:
    found = [f.deliveries[0].delay_ns for f in fates(Reorder(probability=0.1, delay_s=0.5))]
    assert set(found) == {0, 500_000_000}
    held = [n for n, delay in enumerate(found) if delay]
    assert within_99_percent(len(held) / MANY, 0.1)
    arrivals = sorted(range(MANY), key=lambda n: (n * TICK_NS + found[n], n))
    assert arrivals != list(range(MANY))
    place = {n: p for p, n in enumerate(arrivals)}
    overtaken = [n for n in held if n + 4 < MANY and place[n] > place[n + 4]]
    prompt = [n for n in held if n + 4 < MANY and not found[n + 4]]
    assert set(prompt) <= set(overtaken)


def queued(sent: list[LinkMessage], bits_per_s: int, queue: int) -> list[int | None]:
    """After how many ns each message is through, or None if too many are waiting already."""
    begins_ns, out = list[int](), list[int | None]()
    free_ns = 0
    for link_message in sent:
        waiting = sum(begin > link_message.t_ns for begin in begins_ns[-queue - 2 :])
        if free_ns > link_message.t_ns and waiting >= queue:
            out.append(None)
            continue
        begins_ns.append(max(link_message.t_ns, free_ns))
        free_ns = begins_ns[-1] + link_message.bits * (10**9 // bits_per_s)
        out.append(free_ns - link_message.t_ns)
    return out


@pytest.mark.parametrize(("bits_per_s", "queue"), [(3125, 0), (5000, 3), (4000, 20)])
def test_a_rate_is_that_of_a_simulated_queue(bits_per_s: int, queue: int) -> None:
    ticks = sorted(n + n // 7 * 5 % 3 for n in range(MANY))  # several in some ticks, in some none
    sizes = [200 + (n * n * 37) % 900 for n in range(MANY)]
    sent = [
        LinkMessage(1, 2, "adsb", n, tick * TICK_NS, bits)
        for n, (tick, bits) in enumerate(zip(ticks, sizes, strict=True))
    ]
    found = channel(Rate(bits_per_s=bits_per_s, queue=queue))
    expected = queued(sent, bits_per_s, queue)
    assert expected.count(None) > 1000
    for link_message, delay_ns in zip(sent, expected, strict=True):
        passed = Fate((), "rate") if delay_ns is None else Fate((Delivery(delay_ns),))
        assert found.fate(link_message) == passed


def test_each_direction_of_a_link_has_a_rate_of_its_own() -> None:
    found = channel(Rate(bits_per_s=1000.0, queue=0))
    for src, dst in ((1, 2), (2, 1), (1, 3)):
        assert (
            found.fate(LinkMessage(src, dst, "adsb", 0, 0, 500)).deliveries[0].delay_ns
            == 500_000_000
        )
    assert found.fate(LinkMessage(1, 2, "cmd", 0, 0, 500)).dropped_by == "rate"


# duplicate, replay, corrupt


@pytest.mark.parametrize("kind", [Duplicate, Replay])
def test_copies_are_as_many_and_as_late_as_said(kind: type[Duplicate]) -> None:
    later_ns = 5_000_000_000 if kind is Replay else 0
    found = fates(Latency(base_s=0.3, distribution="constant"), kind(probability=0.2))
    copied = [f for f in found if len(f.deliveries) == 2]
    assert within_99_percent(len(copied) / MANY, 0.2)
    for fate in found:
        assert not fate.dropped_by
        delays = [p.delay_ns for p in fate.deliveries]
        assert delays == [300_000_000, 300_000_000 + later_ns][: len(delays)]


def test_with_a_frame_check_what_is_corrupted_is_rejected() -> None:
    found = fates(Corrupt(probability=0.2, bits=3))
    assert within_99_percent(sum(f == Fate((), "corrupt") for f in found) / MANY, 0.2)
    assert not any(p.flips for f in found for p in f.deliveries)


def test_without_a_frame_check_so_many_bits_are_flipped_anywhere() -> None:
    found = fates(Corrupt(probability=0.5, bits=3, frame_check=False))
    flips = [f.deliveries[0].flips for f in found]
    assert within_99_percent(sum(map(bool, flips)) / MANY, 0.5)
    assert {len(places) for places in flips} == {0, 3}
    places = [place for some in flips for place in some]
    assert min(places) < 0.001
    assert 0.999 < max(places) < 1.0
    for decile in range(10):
        part = sum(decile <= 10 * place < decile + 1 for place in places) / len(places)
        assert part == pytest.approx(0.1, rel=0.03)


def test_every_copy_of_a_message_is_accounted_for() -> None:
    plan = (
        Loss(probability=0.1),
        Duplicate(probability=0.3),
        Duplicate(probability=0.2, delay_s=0.4),
        Replay(probability=0.1),
        Corrupt(probability=0.05),
    )
    found = fates(*plan)
    dropped = [f.dropped_by for f in found if f.dropped_by]
    assert within_99_percent(dropped.count("loss") / MANY, 0.1)
    assert within_99_percent(dropped.count("corrupt") / MANY, 0.9 * 0.05)
    assert set(dropped) == {"loss", "corrupt"}
    assert all(bool(f.dropped_by) != bool(f.deliveries) for f in found)
    copies = sum(len(f.deliveries) - 1 for f in found if f.deliveries)
    assert copies / (MANY - len(dropped)) == pytest.approx(0.3 + 0.2 + 0.1, rel=0.02)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@fast
def test_what_a_rare_fault_hits_a_frequent_one_hits_too(one: float, other: float) -> None:
    rare, frequent = sorted((one, other))
    for kind in (Duplicate, Replay, Reorder, Corrupt):
        for low, high in zip(
            fates(kind(probability=rare), count=50),
            fates(kind(probability=frequent), count=50),
            strict=True,
        ):
            untouched = Fate(low.deliveries[:1])
            assert low == high or (low == untouched and high != untouched)


def test_a_link_is_as_bad_as_it_was_however_long_ago(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run may last for days: what is kept of it does not grow, and nothing depends on that."""
    sent, rule = stream(count=3000), Burst(loss=0.3, mean_ticks=5.0)
    remembering = lost(channel(rule), sent)
    monkeypatch.setattr("fleet.faults.kinds.burst.TICKS_KEPT", 16)
    forgetful = channel(rule)
    assert lost(forgetful, sent) == remembering
    assert lost(forgetful, sent[::-7]) == remembering[::-7]
