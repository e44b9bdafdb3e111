"""Delivery and latency of links: against loops over the raw messages, and against the plan."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from typing import Any

import numpy as np
import pytest

from fleet.analysis.metrics import LinkMetrics, RecordedRun, RunMetrics, measure
from fleet.analysis.metrics.data import SEQ
from fleet.analysis.metrics.expected import chances, concerning, expected_latency, patterns_of
from fleet.faults.channel import Channel
from fleet.faults.draws import LinkMessage
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.partition import Partition
from fleet.faults.kinds.range import Range
from fleet.faults.kinds.rate import Rate
from fleet.faults.kinds.reorder import Reorder
from fleet.faults.kinds.replay import Replay
from fleet.faults.rules import Rule
from fleet.model.units import to_ns
from tests.analysis.test_check_story import RecordedRunBuilder, apart, broadcast
from tests.analysis.test_metrics import flown, messages_in
from tests.analysis.test_metrics_run import PLAN
from tests.support import samples

Key = tuple[int, int, str]
CAME = ("received", "altered", "implausible")


@pytest.fixture(scope="module")
def lossy() -> RecordedRun:
    return flown(samples.head_on(fault=PLAN, seed=5))


@pytest.fixture(scope="module")
def run(lossy: RecordedRun) -> RunMetrics:
    return measure(lossy)


def link_of(run: RunMetrics, src: int, dst: int, kind: str) -> LinkMetrics:
    (found,) = [r for r in run.links if (r.src, r.dst, r.kind) == (src, dst, kind)]
    return found


def receivers(topic: str, uavs: int) -> list[int]:
    """Who hears a topic."""
    issuer, kind, *rest = topic.split("/")
    src = 0 if issuer == "coordinator" else int(issuer)
    if kind in ("cmd", "ack"):
        return [int(rest[0])]
    everybody = range(0 if kind == "adsb" else 1, uavs + 1)
    return [n for n in everybody if n != src]


def sent_on(recorded_run: RecordedRun) -> dict[Key, list[int]]:
    """Times of sending on every link."""
    out: defaultdict[Key, list[int]] = defaultdict(list)
    for r in recorded_run.records:
        kind = r.topic.split("/")[1]
        if kind in ("adsb", "heartbeat", "election", "cmd", "ack"):
            m = samples.unpack(r.payload)
            for dst in receivers(r.topic, 3):
                out[m["id"], dst, kind].append(m["t_ns"])
    return out


def fates_on(recorded_run: RecordedRun) -> dict[Key, dict[int, list[tuple[str, int, int]]]]:
    """What every receiver reported of each message: fate, sent, delivered, in order of delivery."""
    out: defaultdict[Key, Any] = defaultdict(lambda: defaultdict(list))
    names = ("src", "kinds", "seqs", "fates", "sent_ns", "delivered_ns")
    for m in messages_in(recorded_run, "delivery"):
        for src, kind, seq, *rest in zip(*(m[name] for name in names), strict=True):
            out[src, m["id"], kind][seq].append(tuple(rest))
    return out


def test_links_are_as_the_messages_and_reports_say(lossy: RecordedRun, run: RunMetrics) -> None:
    sent, fates = sent_on(lossy), fates_on(lossy)
    assert {(r.src, r.dst, r.kind) for r in run.links} == set(sent)
    for row in run.links:
        assert row.src is not None
        assert row.dst is not None
        key = (row.src, row.dst, row.kind)
        came = {
            seq: min((d - s for fate, s, d in told if fate in CAME))
            for seq, told in fates[key].items()
            if any(fate in CAME for fate, _, _ in told)
        }
        lost = {seq: told[0][0] for seq, told in fates[key].items() if seq not in came}
        assert row.sent == len(sent[key])
        assert row.delivered == len(came)
        assert row.copies == sum(f in CAME for t in fates[key].values() for f, _, _ in t) - len(
            came
        )
        assert row.dropped == dict(Counter(lost.values()))
        until_ns = 60 * 10**9 - max(came.values(), default=0)
        early = {seq for seq, told in fates[key].items() if told[0][1] <= until_ns}
        assert row.settled == len(early)
        assert row.latency_s.count == len(came)
        if came:
            assert row.delivery_ratio == pytest.approx(len(early & came.keys()) / len(early))
            assert row.latency_s.mean == pytest.approx(sum(came.values()) / len(came) / 1e9)
            assert row.latency_s.max == max(came.values()) / 1e9


def test_what_was_injected_is_what_is_expected_and_about_what_came(run: RunMetrics) -> None:
    for row in run.classes:
        assert row.expected_ratio == pytest.approx(0.8)
        assert row.expected_latency_s.mean == pytest.approx(0.3)
        assert row.expected_latency_s.p95 == pytest.approx(0.345, abs=1e-4)
        assert row.expected_latency_s.count == row.delivered
        if row.settled > 500:
            assert row.delivery_ratio == pytest.approx(0.8, abs=4.0 * 0.4 / math.sqrt(row.settled))
            assert row.latency_s.mean == pytest.approx(0.3, abs=0.005)
            assert row.latency_s.p95 == pytest.approx(0.345, abs=0.005)


def test_classes_are_the_sums_of_their_links(run: RunMetrics) -> None:
    for row in run.classes:
        links = [link for link in run.links if link.kind == row.kind]
        for name in ("sent", "delivered", "copies", "settled"):
            assert getattr(row, name) == sum(getattr(link, name) for link in links)
        assert row.dropped == dict(sum((Counter(link.dropped) for link in links), Counter()))
        assert row.latency_s.max == max(link.latency_s.max or 0.0 for link in links)


def told(*fates: str, plan: tuple[Rule, ...] = ()) -> LinkMetrics:
    """UAV 1 broadcasts, and so it fares on the way to UAV 2."""
    run_builder = RecordedRunBuilder(apart(), *plan)
    uav = run_builder.scenario.uav[0]
    for n, fate in enumerate(fates):
        said = run_builder.say(broadcast(uav, 0.2 * n))
        for part in filter(None, fate.split("+")):
            run_builder.hear(2, said, fate=part)
    return link_of(measure(run_builder.recorded_run()), 1, 2, "adsb")


def test_the_ratio_is_of_messages_whose_fate_is_known() -> None:
    found = told("received", "loss", "", "altered", "implausible", "burst")
    assert (found.sent, found.delivered, found.settled) == (6, 3, 5)
    assert found.dropped == {"burst": 1, "loss": 1}
    assert found.delivery_ratio == pytest.approx(0.6)


def test_what_comes_twice_counts_once() -> None:
    found = told("received+received", "received", "corrupt+received")
    assert (found.sent, found.delivered, found.copies) == (3, 3, 1)
    assert (found.latency_s.count, found.dropped) == (3, {})


def test_what_has_no_fate_has_no_ratio() -> None:
    found = told("", "")
    assert (found.sent, found.settled, found.delivery_ratio) == (2, 0, None)
    assert (found.expected_ratio, found.latency_s.count) == (None, 0)


def test_long_delays_do_not_make_the_last_losses_weigh_more() -> None:
    """Of 20 s, what was sent in the last 5 s is lost or still on its way."""
    run_builder = RecordedRunBuilder(apart(duration_s=20.0))
    uav = run_builder.scenario.uav[0]
    for n in range(100):
        said = run_builder.say(broadcast(uav, 0.2 * n))
        if n % 5 == 0:
            run_builder.hear(2, said, fate="loss")
        elif n < 75:
            run_builder.hear(2, said, after_s=5.0)
    found = link_of(measure(run_builder.recorded_run()), 1, 2, "adsb")
    assert found.delivered == 60
    assert found.settled == 76  # up to 15.0 s
    assert found.delivery_ratio == pytest.approx(60 / 76)


# what a plan lets one expect

LINK = LinkMessage(1, 2, "adsb", 0, 0)
TIMES = np.arange(0, to_ns(60.0), to_ns(0.2))


def passing(*plan: Rule, distance_m: float = math.nan, link: LinkMessage = LINK) -> float | None:
    found = chances(
        concerning(plan, link), link, TIMES, np.full(len(TIMES), 2400),
        lambda: np.full(len(TIMES), distance_m),
    )  # fmt: skip
    return None if found is None else float(found.mean())


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        ([], 1.0),
        ([Loss(probability=0.25)], 0.75),
        ([Loss(probability=0.25), Loss(probability=0.5)], 0.375),
        ([Loss(probability=0.5, start_s=15.0, end_s=30.0)], 0.875),
        ([Loss(probability=0.5, src="2")], 1.0),
        ([Loss(probability=0.5, dst="2", classes="cmd,adsb")], 0.5),
        ([Loss(probability=0.5, classes="cmd")], 1.0),
        ([Burst(loss=0.2, mean_ticks=5.0)], 0.8),
        ([Burst(loss=0.9, mean_ticks=2.0)], None),
        ([Partition(groups="1/2,3", end_s=15.0)], 0.75),
        ([Partition(groups="1,2/3")], 1.0),
        ([Corrupt(probability=0.1)], 0.9),
        ([Corrupt(probability=0.1, frame_check=False)], None),
        ([Rate(bits_per_s=1e6)], None),
        ([Rate(bits_per_s=1e6, start_s=70.0)], 1.0),
        ([Latency(base_s=1.0), Reorder(probability=0.1), Replay(probability=0.2)], 1.0),
        ([Duplicate(probability=0.2), Loss(probability=0.1)], 0.9),
    ],
)
def test_the_expected_delivery_ratio(plan: list[Rule], expected: float | None) -> None:
    assert passing(*plan) == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(
    ("rule", "distance_m", "expected"),
    [
        (Range(model="rayleigh", scale_m=1000.0), 700.0, math.exp(-0.49)),
        (Range(model="polynomial", quadratic_per_m2=1e-6, linear_per_m=1e-4), 500.0, 0.7),
        (Range(max_m=500.0), 501.0, 0.0),
        (Range(max_m=500.0), 499.0, 1.0),
        (Range(max_m=500.0), math.nan, None),
        (Range(model="log_distance", shadowing_db=4.0), 500.0, None),
    ],
)
def test_the_expected_delivery_ratio_by_distance(
    rule: Range, distance_m: float, expected: float | None
) -> None:
    found = passing(rule, distance_m=distance_m)
    assert found == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(
    "plan",
    [
        [Burst(loss=0.3, mean_ticks=2.0)],
        [Loss(probability=0.2), Corrupt(probability=0.1), Partition(groups="1/2", end_s=30.0)],
        [Range(model="rayleigh", scale_m=900.0), Burst(loss=0.1, mean_ticks=1.0)],
        [Range(model="log_distance", power_dbm=-3.0, exponent=2.2)],
    ],
)
def test_expected_is_what_channels_do_in_the_mean(plan: list[Rule]) -> None:
    """Over several seeds: the mean is within four standard errors."""
    passed = []
    for seed in range(8):
        channel = Channel(plan, seed, to_ns(0.1))
        link_messages = [
            LinkMessage(1, 2, "adsb", n, int(t), 2400, 650.0) for n, t in enumerate(TIMES)
        ]
        passed += [bool(channel.fate(link_message).deliveries) for link_message in link_messages]
    expected = passing(*plan, distance_m=650.0)
    assert expected is not None
    error = math.sqrt(expected * (1.0 - expected) / len(passed))
    assert np.mean(passed) == pytest.approx(expected, abs=6.0 * error + 1e-9)


def test_the_distance_is_the_true_one_at_sending() -> None:
    rule = Range(model="polynomial", linear_per_m=4e-4)
    recorded_run = flown(samples.head_on(fault=(rule,), resolver="none"))
    found = link_of(measure(recorded_run), 1, 2, "adsb")
    places = {(m["id"], m["t_ns"]): m["position_ned_m"] for m in messages_in(recorded_run, "truth")}
    sent = [m["t_ns"] for m in messages_in(recorded_run, "adsb") if m["id"] == 1]
    loss = [min(1.0, 4e-4 * math.dist(places[1, t], places[2, t])) for t in sent if t < 60 * 10**9]
    assert found.expected_ratio == pytest.approx(1.0 - sum(loss) / len(loss))
    assert found.delivery_ratio == pytest.approx(found.expected_ratio, abs=0.1)
    assert found.expected_ratio is not None
    assert 0.5 < found.expected_ratio < 0.95
    to_coordinator = link_of(measure(recorded_run), 2, 0, "adsb")
    loss = [min(1.0, 4e-4 * math.dist(places[2, t], (0, 0, 0))) for t in sent if t < 60 * 10**9]
    assert to_coordinator.expected_ratio == pytest.approx(1.0 - sum(loss) / len(loss))


def spread(*plan: Rule, least_s: float = 0.1) -> tuple[float | None, ...]:
    found = expected_latency(patterns_of(concerning(plan, LINK), TIMES), least_s)
    assert found.max is None
    return found.mean, found.p50, found.p95


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        ([], (0.1, 0.1, 0.1)),
        ([Latency(base_s=0.3, distribution="constant", jitter_s=9.0)], (0.3, 0.3, 0.3)),
        ([Latency(base_s=0.3, jitter_s=0.1)], (0.3, 0.3, 0.39)),
        ([Latency(base_s=0.02)], (0.1, 0.1, 0.1)),
        ([Latency(base_s=0.3, jitter_s=0.1), Latency(base_s=0.2)], (0.5, 0.5, 0.59)),
        # uniform over [-0.2, 0.4]: a half comes at the tick
        ([Latency(base_s=0.1, jitter_s=0.3)], (0.1 + 0.3 / 4.0, 0.1, 0.37)),
        ([Latency(jitter_s=0.5, distribution="exponential")],
         (0.1 + 0.5 * math.exp(-0.2), 0.5 * math.log(2.0), 0.5 * math.log(20.0))),
        ([Latency(base_s=0.2, jitter_s=0.3, distribution="lognormal")],
         (0.2 + 0.3 * math.exp(0.5), 0.5, 0.2 + 0.3 * math.exp(1.6448536))),
        ([Latency(base_s=1.0, cap_s=0.4)], (0.4, 0.4, 0.4)),
        # in force for a fifth of the messages
        ([Latency(base_s=0.6, end_s=12.0)], (0.2, 0.1, 0.6)),
        ([Loss(probability=0.5), Duplicate(probability=0.5, delay_s=1.0)], (0.1, 0.1, 0.1)),
        ([Latency(jitter_s=0.1), Latency(jitter_s=0.1)], (None, None, None)),
        ([Latency(base_s=0.3), Reorder(probability=0.1)], (None, None, None)),
        ([Rate(bits_per_s=1e4)], (None, None, None)),
        ([Rate(bits_per_s=1e4, start_s=70.0)], (0.1, 0.1, 0.1)),
    ],
)  # fmt: skip
def test_the_expected_latency(plan: list[Rule], expected: tuple[float | None, ...]) -> None:
    found = spread(*plan)
    if None in expected:
        assert found == expected
    else:
        assert found == pytest.approx(expected, rel=5e-3, abs=1e-4)


def test_in_realtime_there_is_no_least_latency() -> None:
    assert spread(Latency(base_s=0.02), least_s=0.0) == pytest.approx((0.02, 0.02, 0.02))
    assert spread(least_s=0.0) == (0.0, 0.0, 0.0)


def test_a_realtime_run_expects_the_injected_delay_alone() -> None:
    run_builder = RecordedRunBuilder(apart(), Latency(base_s=0.02))
    said = run_builder.say(broadcast(run_builder.scenario.uav[0], 0.2))
    run_builder.hear(2, said)
    found = link_of(measure(run_builder.recorded_run(realtime=True)), 1, 2, "adsb")
    assert found.expected_latency_s.mean == pytest.approx(0.02)
    assert found.latency_s.mean == pytest.approx(0.1)


def test_numbers_of_a_later_incarnation_are_matched_though_a_log_keeps_fewer_bits() -> None:
    assert (5 * 10**9) & SEQ == 5 * 10**9 - 2**32
    run_builder = RecordedRunBuilder(apart())
    uav = run_builder.scenario.uav[0]
    said = run_builder.say(broadcast(uav, 0.2))
    run_builder._seq[1, "adsb"] = 5 * 10**9
    late = run_builder.say(broadcast(uav, 0.4))
    run_builder.hear(2, said)
    run_builder.hear(2, late)
    found = link_of(measure(run_builder.recorded_run()), 1, 2, "adsb")
    assert (found.sent, found.delivered, found.delivery_ratio) == (2, 2, 1.0)
    assert found.expected_ratio == 1.0
