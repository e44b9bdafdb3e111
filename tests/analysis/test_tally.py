"""Counts of a run, against counting by hand."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis.latency_bins import binned_quantiles_s, latency_bin
from fleet.analysis.tally import RunTally, quantiles
from fleet.protocol.messages import (
    Ack,
    Command,
    Conflict,
    Decision,
    DeliveryReport,
    Election,
    Late,
    Message,
)
from tests.support.samples import MS, SAMPLES, S, ack, adsb, command, election, encounter, heartbeat

fast = settings(deadline=None, derandomize=True, max_examples=150)


def tally(*messages: Message) -> RunTally:
    counted = RunTally()
    for message in messages:
        counted.add(message)
    return counted


elected = st.builds(
    election,
    st.integers(1, 5),
    st.sampled_from([(1, 2), (2, 3), (4, 5)]),
    st.integers(1, 5),
    st.integers(0, 9),
)
commands = st.builds(
    command,
    id=st.integers(1, 2),
    term=st.integers(1, 3),
    number=st.integers(1, 3),
    target=st.integers(1, 3),
    seq=st.integers(0, 99),
)
answers = st.builds(
    ack,
    commands,
    st.sampled_from(["", "duplicate", "expired", "stale_term"]),
    actuate_ns=st.integers(S, 3 * S),
)
decided = st.lists(
    st.builds(
        encounter,
        st.integers(1, 5),
        st.sampled_from(["axis", "least_bad", "keep"]),
        st.sampled_from([0.0, 0.99, 1.0, 1.5]),
    )
).map(lambda e: Decision(1, 0, 0, 1, tuple(e)))
late = st.builds(Late, st.integers(0, 5), st.just(0), st.just(0), st.integers(0, 10**9))
runs = st.lists(st.one_of(elected, commands, answers, decided, late), max_size=25)


@given(runs)
@fast
def test_counts_are_those_of_the_messages(run: list[Message]) -> None:
    counted = tally(*run)
    commands = [m for m in run if isinstance(m, Command)]
    acks = [m for m in run if isinstance(m, Ack)]
    assert set(counted.terms) == {m.term for m in run if isinstance(m, Election)}
    assert counted.transmissions == len(commands)
    assert set(counted.issued) == {(m.term, m.id, m.number) for m in commands}
    assert set(counted.applied) == {(m.term, m.target, m.number) for m in acks if m.accepted}
    assert counted.refused == Counter(
        m.reason for m in acks if m.reason and m.reason != "duplicate"
    )
    stuck = {
        (m.term, e.target)
        for m in run
        if isinstance(m, Decision)
        for e in m.encounters
        if e.least_separation < 1.0
    }
    assert counted.unresolved == len(stuck)
    assert counted.late == Counter(latency_bin(m.late_ns) for m in run if isinstance(m, Late))


def test_a_retransmitted_command_is_issued_once() -> None:
    counted = tally(
        command(seq=0), command(seq=1, t_ns=2 * S), command(seq=2, number=2, manoeuvre="resume")
    )
    assert counted.transmissions == 3
    assert counted.issued == {(3, 1, 1): "turn", (3, 1, 2): "resume"}


def test_an_applied_command_is_known_by_what_issued_it() -> None:
    sent = command(id=4, target=2, issued_ns=S)
    counted = tally(sent, ack(sent, actuate_ns=S + 250 * MS), ack(sent, "duplicate"))
    assert set(counted.applied) == set(counted.issued) == {(3, 4, 1)}
    assert counted.applied[3, 4, 1] == pytest.approx(0.25)
    assert not counted.refused


@given(st.lists(st.tuples(st.integers(0, 10**10), st.integers(1, 10**9)), max_size=20))
@fast
def test_delivery_latency_is_the_time_from_sending_to_delivery(
    deliveries: list[tuple[int, int]],
) -> None:
    n = len(deliveries)
    sent = tuple(t for t, _ in deliveries)
    got = tuple(t + lag for t, lag in deliveries)
    kinds, fates = n * ("adsb",), n * ("received",)
    counted = tally(DeliveryReport(2, 0, 0, n * (1,), kinds, tuple(range(n)), sent, got, fates))
    assert counted.fates.total() == n
    lags = sorted(latency_bin(lag) / 1e5 for _, lag in deliveries)
    last = len(lags) - 1
    if lags:
        found = binned_quantiles_s(counted.latencies["adsb"])
        assert found["p50"] == pytest.approx(lags[round(0.5 * last)])
        assert found["p99"] == pytest.approx(lags[round(0.99 * last)])
        assert found["max"] == pytest.approx(lags[-1])


def test_true_states_and_bookkeeping_are_not_counted() -> None:
    others = [m for m in SAMPLES if m.kind in {"truth", "persistent_state", "done"}]
    assert len(others) == 3
    assert tally(*others) == RunTally()


def test_who_was_ever_left_without_a_leader_is_counted() -> None:
    told = ((), (1, 2), (), (2, 5))
    counted = tally(*(Conflict(0, n, n, (), (), ids) for n, ids in enumerate(told)))
    assert counted.leaderless == {1, 2, 5}


def test_the_deaf_are_no_receivers() -> None:
    counted = RunTally(uavs=3, coordinator=True, deaf=frozenset({2, 3}))
    counted.add(adsb(1))
    counted.add(adsb(2))
    assert counted.sent["adsb"] == 1 + 2
    counted.add(command(target=2))
    counted.add(command(target=1))
    assert counted.sent["cmd"] == 1


@pytest.mark.parametrize(
    ("message", "receivers"),
    [
        (adsb(1), 3),
        (heartbeat(0), 3),
        (election(4, (1, 2), 1, 0), 3),
        (election(1, (1, 2), 1, 0, elector=1), 2),
        (command(), 1),
        (ack(command()), 1),
    ],
)
def test_what_is_heard_is_counted_once_a_message_and_once_a_receiver(
    message: Message, receivers: int
) -> None:
    """Of three UAVs and a coordinator, which hears broadcasts alone."""
    counted = RunTally(uavs=3, coordinator=True)
    counted.add(message)
    assert counted.transmitted == {message.kind: 1}
    assert counted.sent == {message.kind: receivers}
    alone = RunTally(uavs=3, coordinator=False)
    alone.add(message)
    assert alone.sent[message.kind] == receivers - (message.kind == "adsb")


@given(st.lists(st.tuples(st.integers(0, 10**9), st.integers(0, 10**8)), max_size=20))
@fast
def test_the_slip_is_that_of_messages_that_a_fault_delayed(rows: list[tuple[int, int]]) -> None:
    n = len(rows)
    delays, slips = tuple(d for d, _ in rows), tuple(s for _, s in rows)
    ones = n * (1,)
    columns = (ones, n * ("adsb",), ones, ones, ones, n * ("received",), ones, delays, slips)
    counted = tally(DeliveryReport(2, 0, 0, *columns))
    assert counted.accuracy()["count"] == sum(d > 0 for d in delays)
    expected = sorted(s // 10_000 * 10_000 / 1e9 for d, s in rows if d)
    found = counted.accuracy()["slip_s"]
    assert found.get("max") == (pytest.approx(expected[-1]) if expected else None)


@given(st.lists(elected, max_size=10), st.integers(0, 9))
@fast
def test_those_compute_whose_groups_last_election_is_still_valid(
    run: list[Election], now_ns: int
) -> None:
    last: dict[int, Election] = {}
    for m in run:
        last = {g: old for g, old in last.items() if g not in m.members}
        last[m.group] = m
    expected = {m.computing for m in last.values() if m.valid_until_ns >= now_ns}
    assert tally(*run).computing_now(now_ns) == sorted(expected)


def test_no_values_have_no_quantiles() -> None:
    assert quantiles([]) == {}


def test_quantiles_of_a_hundred_and_one_values() -> None:
    values = [float(v) for v in range(101)]
    assert quantiles(values[::-1]) == {"p50": 50.0, "p99": 99.0, "max": 100.0}


@given(st.lists(st.floats(0.0, 100.0), min_size=1, max_size=300))
@fast
def test_quantiles_have_their_share_of_values_below(values: list[float]) -> None:
    found = quantiles(values)
    n = len(values)
    assert set(found.values()) <= set(values)
    assert found["max"] == max(values)
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        assert sum(v <= found[name] for v in values) >= share * n - 1
        assert sum(v >= found[name] for v in values) >= (1 - share) * n - 1


def test_latency_is_not_by_the_clock_of_the_issuer() -> None:
    told = command(t_ns=10 * S, issued_ns=40 * S, start_ns=10 * S + 200 * MS)
    tally = RunTally()
    for message in (told, command(t_ns=11 * S, issued_ns=40 * S), ack(told)):
        tally.add(message)
    assert list(tally.applied.values()) == pytest.approx([0.2])
