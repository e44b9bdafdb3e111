"""Faults are what they say, repeatable from the seed, and all accounted for."""

from __future__ import annotations

import json
import math
import statistics
from collections import Counter
from itertools import pairwise
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.comms.messages import Adsb, Delivery, Message
from fleet.comms.participant import lockstep_station
from fleet.model.faults.channel import Channel
from fleet.model.faults.draws import Draws, Hop
from fleet.model.faults.rules import Burst, Corrupt, Duplicate, FaultRule, Latency, Loss, Partition
from fleet.model.faults.shorthand import fraction, rules_of, seconds, window
from fleet.run.ledger import Ledger
from fleet.run.memory import run_in_memory
from fleet.scenarios import convert
from tests.conftest import Cli, Kept
from tests.samples import head_on

TICK_NS = 100_000_000
MANY = 100_000
fast = settings(deadline=None, derandomize=True, max_examples=50)
hops = st.builds(
    Hop,
    st.integers(0, 9),
    st.integers(0, 9),
    st.sampled_from(("adsb", "election", "cmd", "ack")),
    st.integers(0, 10**6),
    st.integers(0, 10**12),
)


def channel(*rules: FaultRule, seed: int = 1) -> Channel:
    return Channel(rules, seed, TICK_NS)


def stream(count: int = MANY, src: int = 1, dst: int = 2) -> list[Hop]:
    """Broadcasts of one UAV as one receiver gets them, one a tick."""
    return [Hop(src, dst, "adsb", n, n * TICK_NS) for n in range(count)]


def lost(found: Channel, sent: list[Hop]) -> list[bool]:
    return [bool(found.fate(hop).dropped_by) for hop in sent]


@pytest.mark.parametrize("probability", [0.1, 0.3, 0.5, 0.8])
def test_loss_is_within_its_99_percent_interval(probability: float) -> None:
    rate = sum(lost(channel(Loss(probability=probability)), stream())) / MANY
    assert abs(rate - probability) < 2.576 * math.sqrt(probability * (1 - probability) / MANY)


def test_what_a_low_loss_drops_a_higher_one_drops_too() -> None:
    dropped = [set[int]()] * 0
    for probability in (0.0, 0.1, 0.3, 0.5, 0.8, 1.0):
        flags = lost(channel(Loss(probability=probability)), stream(5000))
        dropped.append({n for n, gone in enumerate(flags) if gone})
    assert all(low <= high for low, high in pairwise(dropped))
    assert (len(dropped[0]), len(dropped[-1])) == (0, 5000)


@pytest.mark.parametrize(("loss", "mean_ticks"), [(0.1, 3.0), (0.3, 5.0), (0.5, 2.0)])
def test_bursts_have_their_loss_and_mean_length_within_5_percent(
    loss: float, mean_ticks: float
) -> None:
    flags = lost(channel(Burst(loss=loss, mean_ticks=mean_ticks)), stream(4 * MANY))
    bursts = [len(run) for run in "".join("x" if f else " " for f in flags).split()]
    assert sum(flags) / len(flags) == pytest.approx(loss, rel=0.05)
    assert statistics.mean(bursts) == pytest.approx(mean_ticks, rel=0.05)


def delays_s(rule: Latency) -> list[float]:
    found = channel(rule)
    return sorted(found.fate(h).passages[0].delay_ns / 1e9 for h in stream())


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


def test_a_partition_passes_nothing_between_its_sides_while_it_lasts() -> None:
    found = channel(Partition(groups="1,2/3,coordinator", start_s=60.0, end_s=90.0))
    for src, dst in ((1, 3), (3, 2), (0, 1), (2, 0)):
        fates = [found.fate(Hop(src, dst, "adsb", n, n * TICK_NS)) for n in range(1200)]
        assert [n for n, f in enumerate(fates) if f.dropped_by] == list(range(600, 900))
    for src, dst in ((1, 2), (0, 3), (4, 1), (3, 4)):
        assert not any(lost(found, stream(1200, src, dst)))


@given(hops)
@fast
def test_an_empty_plan_does_nothing(hop: Hop) -> None:
    (only,) = channel().fate(hop).passages
    assert (only.delay_ns, only.flips) == (0, ())


@given(st.lists(hops, max_size=30), st.randoms(use_true_random=False))
@fast
def test_fates_do_not_depend_on_the_order_of_arrival(sent: list[Hop], rng: Any) -> None:
    plan = (
        Latency(base_s=0.1, jitter_s=0.1),
        Loss(probability=0.2),
        Burst(loss=0.2),
        Duplicate(probability=0.2),
        Corrupt(probability=0.2),
    )
    sent = [msgspec.structs.replace(h, t_ns=h.t_ns % (100 * TICK_NS)) for h in sent]
    one, other = channel(*plan), channel(*plan)
    shuffled = rng.sample(sent, len(sent))
    expected = {hop: one.fate(hop) for hop in sent}
    assert {hop: other.fate(hop) for hop in shuffled} == expected


@given(st.integers(0, 2**40), st.integers(0, 2**40), st.text(max_size=5))
@fast
def test_draws_are_a_function_of_seed_and_label(one: int, two: int, label: str) -> None:
    assert Draws(one).uniform(label, 1) == Draws(one).uniform(label, 1)
    assert (Draws(one).uniform(label) == Draws(two).uniform(label)) == (one == two)
    assert 0.0 < Draws(one).uniform(label) < 1.0


def test_rules_concern_whom_and_when_they_say() -> None:
    rule = Loss(probability=1.0, src="1,2", dst="uav", classes="cmd,ack", start_s=1.0, end_s=2.0)
    good = Hop(1, 3, "cmd", 0, 1_000_000_000)
    assert rule.concerns(good)
    for change in ({"src": 12}, {"dst": 0}, {"kind": "adsb"}, {"t_ns": 2_000_000_000}, {"t_ns": 9}):
        assert not rule.concerns(msgspec.structs.replace(good, **change))


def under(*rules: FaultRule, name: str = "four_way", **changes: Any) -> Kept:
    """Fly a scenario in memory under a fault plan."""
    from fleet.scenarios import load

    scenario = msgspec.structs.replace(load(name).scenario, fault=rules, **changes)
    ledger = Kept(scenario)
    for _ in run_in_memory(scenario, ledger):
        pass
    return ledger


def test_every_message_is_received_or_dropped_by_a_named_rule_or_in_flight() -> None:
    run = under(
        Loss(probability=0.1),
        Latency(base_s=0.3, jitter_s=0.1),
        Duplicate(probability=0.1, delay_s=0.5),
        Corrupt(probability=0.05, bits=3),
        duration_s=40.0,
    )
    sent = Counter(m.id for m in run.kept if isinstance(m, Adsb))
    reports = [m for m in run.kept if isinstance(m, Delivery)]
    rows = Counter(
        (r.id, src, seq, fate)
        for r in reports
        for src, kind, seq, fate in zip(r.src, r.kinds, r.seqs, r.fates, strict=True)
        if kind == "adsb"
    )
    assert {fate for *_, fate in rows} <= {"received", "altered", "corrupt", "loss"}
    horizon = {uav: max(1, count - 10) for uav, count in sent.items()}  # the rest may be in flight
    for dst in range(5):
        for src, count in sent.items():
            fates = [
                sum(rows[dst, src, seq, f] for f in ("received", "altered", "corrupt", "loss"))
                for seq in range(count)
            ]
            if dst == src:
                assert sum(fates) == 0
            else:
                assert min(fates[: horizon[src]]) >= 1
                assert max(fates) <= 2
    assert sum(n for (*_, fate), n in rows.items() if fate == "corrupt") > 0


def test_a_latency_delays_every_delivery_exactly() -> None:
    run = under(Latency(base_s=0.35, distribution="constant"), duration_s=20.0)
    reports = [m for m in run.kept if isinstance(m, Delivery)]
    assert reports
    for r in reports:
        for sent, got in zip(r.sent_ns, r.delivered_ns, strict=True):
            assert got == sent + 350_000_000
            assert r.t_ns - TICK_NS < got <= r.t_ns


def test_less_than_a_tick_is_a_tick() -> None:
    run = under(Latency(base_s=0.03, distribution="constant"), duration_s=5.0)
    lags = {
        got - sent
        for r in run.kept
        if isinstance(r, Delivery)
        for sent, got in zip(r.sent_ns, r.delivered_ns, strict=True)
    }
    assert lags == {TICK_NS}


def test_a_corrupted_message_is_rejected_or_altered_never_a_crash() -> None:
    run = under(Corrupt(probability=1.0, bits=2), duration_s=60.0)
    fates = Counter[str]()
    for m in run.kept:
        if isinstance(m, Delivery):
            fates.update(m.fates)
    assert set(fates) <= {"corrupt", "altered"}
    assert min(fates["corrupt"], fates["altered"]) > 100


def test_heavy_faults_end_the_flight_without_an_error() -> None:
    plan = (
        Burst(loss=0.5, mean_ticks=20.0),
        Latency(base_s=1.0, jitter_s=0.5),
        Corrupt(probability=0.1),
    )
    run = under(*plan, duration_s=150.0)
    assert run.separation.least() >= 0.0


def test_the_seed_decides() -> None:
    plan = (Loss(probability=0.3),)
    one, again, other = (
        under(*plan, seed=seed, duration_s=30.0, name="head_on").digest for seed in (1, 1, 2)
    )
    assert one == again != other


def test_zenoh_and_memory_agree_under_faults(cli: Cli) -> None:
    faults = ["--latency", "300ms", "--jitter", "150ms", "--loss", "20%", "--corrupt", "2%"]
    arguments = ["run", "head_on", "--duration", "70", "--seed", "3", *faults, "--json"]
    done = [cli.run(*arguments, "--bus", bus) for bus in ("zenoh", "memory")]
    assert [d.returncode for d in done] == [0, 0]
    zenoh, memory = (json.loads(d.stdout) for d in done)
    assert zenoh["digest"] == memory["digest"]
    assert zenoh["delivery"] == memory["delivery"]
    assert zenoh["delivery"]["adsb"]["dropped"]["loss"] > 0


def test_shorthands_say_what_the_tables_say() -> None:
    rules = rules_of("300ms", "50ms", "20%", "5", ("1,2/3,4@60s+30s",), "1%", "0.5%")
    table = {"name": "x", "duration_s": 9.0, "generate": {"kind": "converge"}, "fault": rules}
    latency, burst, partition, duplicate, corrupt = convert(table, "x").fault
    assert latency == Latency(base_s=0.3, jitter_s=0.05)
    assert burst == Burst(loss=0.2, mean_ticks=5.0)
    assert partition == Partition(groups="1,2/3,4", start_s=60.0, end_s=90.0)
    assert duplicate == Duplicate(probability=0.01)
    assert corrupt == Corrupt(probability=0.005)


@pytest.mark.parametrize(
    ("parse", "text"),
    [(seconds, "3 h"), (seconds, ""), (fraction, "120%"), (fraction, "x"), (window, "1/2@x")],
)
def test_what_is_no_shorthand_is_refused(parse: Any, text: str) -> None:
    with pytest.raises(ValueError, match="write"):
        parse(text)


def test_what_is_lost_is_not_delivered_to_the_node() -> None:
    scenario = msgspec.structs.replace(head_on(), fault=(Loss(probability=1.0),))

    class Deaf:
        id = 9
        hears = ("adsb/0",)

        def step(self, now_ns: int, inbox: Any) -> list[Message]:
            assert not inbox
            return []

    from tests.samples import adsb

    station = lockstep_station(Deaf(), scenario)
    message = adsb(1)
    station.accept("1/adsb/0", b"", message=message)
    ((topic, _),) = station.step(10 * TICK_NS)
    assert topic == "9/delivery"
    assert Ledger(scenario, None).digest == ""
