"""Faults in flight: all accounted for, repeatable from the seed, the same on both buses."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

import msgspec
import pytest

from fleet.config.loading import read_scenario
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.rules import Rule
from fleet.node.base import BaseNode
from fleet.node.broadcasts import Reception
from fleet.node.participant import lockstep_runner
from fleet.protocol.messages import DeliveryReport, Message, StateBroadcast
from fleet.protocol.topics import topic_of
from fleet.simulation.result import result_json
from fleet.simulation.run_recorder import RunRecorder
from fleet.simulation.simulation import RunOptions, RunOutcome
from tests.conftest import Cli, KeepingRecorder, kept_run
from tests.support.fault_samples import TICK_NS


def under(*rules: Rule, name: str = "four_way", **changes: Any) -> KeepingRecorder:
    """Fly a scenario in memory under a fault plan."""
    scenario = msgspec.structs.replace(read_scenario(name).scenario, fault=rules, **changes)
    return kept_run(scenario)


FATES = ("received", "altered", "implausible", "corrupt", "loss")
"""What flipped bits have altered may not be believed."""


def test_every_message_is_received_or_dropped_by_a_named_rule_or_in_flight() -> None:
    run = under(
        Loss(probability=0.1),
        Latency(base_s=0.3, jitter_s=0.1),
        Duplicate(probability=0.1, delay_s=0.5),
        Corrupt(probability=0.05, bits=3, frame_check=False),
        duration_s=40.0,
    )
    sent = Counter(m.id for m in run.kept if isinstance(m, StateBroadcast))
    reports = [m for m in run.kept if isinstance(m, DeliveryReport)]
    rows = Counter(
        (r.id, src, seq, fate)
        for r in reports
        for src, kind, seq, fate in zip(r.src, r.kinds, r.seqs, r.fates, strict=True)
        if kind == "adsb"
    )
    assert {fate for *_, fate in rows} <= {*FATES}
    horizon = {uav: max(1, count - 10) for uav, count in sent.items()}  # the rest may be in flight
    for dst in range(5):
        for src, count in sent.items():
            fates = [sum(rows[dst, src, seq, f] for f in FATES) for seq in range(count)]
            if dst == src:
                assert sum(fates) == 0
            else:
                assert min(fates[: horizon[src]]) >= 1
                assert max(fates) <= 2
    assert sum(n for (*_, fate), n in rows.items() if fate == "corrupt") > 0


def test_what_nobody_reports_was_for_the_dead_or_is_from_the_last_tick() -> None:
    run = under(Kill(node="2", start_s=3.0), Loss(probability=0.2), name="head_on", duration_s=6.0)
    outcome = RunOutcome(RunOptions(read_scenario("head_on").scenario), run)
    row = result_json(outcome)["delivery"]["adsb"]
    unreported = [
        (m.id, receiver)
        for m in run.kept
        if isinstance(m, StateBroadcast)
        for receiver in {0, 1, 2} - {m.id}
        if m.t_ns == 6_000_000_000 or (receiver == 2 and m.t_ns + TICK_NS >= 3_000_000_000)
    ]
    assert row["unreported"] == len(unreported) > 10
    assert row["dropped"]["loss"] > 5


def test_a_latency_delays_every_delivery_exactly() -> None:
    run = under(Latency(base_s=0.35, distribution="constant"), duration_s=20.0)
    reports = [m for m in run.kept if isinstance(m, DeliveryReport)]
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
        if isinstance(r, DeliveryReport)
        for sent, got in zip(r.sent_ns, r.delivered_ns, strict=True)
    }
    assert lags == {TICK_NS}


def test_without_a_frame_check_a_message_is_rejected_or_altered_never_a_crash() -> None:
    rule = Corrupt(probability=1.0, bits=2, frame_check=False)
    run = under(rule, duration_s=60.0)
    fates = Counter[str]()
    for m in run.kept:
        if isinstance(m, DeliveryReport):
            fates.update(f for f, src in zip(m.fates, m.src, strict=True) if src != m.id)
    assert set(fates) <= {"corrupt", "altered", "implausible"}
    assert min(fates["corrupt"], fates["altered"]) > 100


def test_a_command_to_oneself_travels_on_no_link() -> None:
    run = under(
        Kill(node="2", start_s=30.0),
        Loss(probability=1.0, start_s=33.0, classes="cmd,ack"),
        Latency(base_s=5.0, start_s=33.0, classes="cmd,ack"),
        name="head_on",
        duration_s=130.0,
    )
    own = [
        (kind, fate, got - sent)
        for m in run.kept
        if isinstance(m, DeliveryReport) and m.id == 1
        for src, kind, fate, sent, got in zip(
            m.src, m.kinds, m.fates, m.sent_ns, m.delivered_ns, strict=True
        )
        if src == 1
    ]
    assert {kind for kind, *_ in own} == {"cmd", "ack"}
    assert {(fate, lag) for _, fate, lag in own} == {("received", TICK_NS)}
    assert run.separation.least() >= 1.0


def test_heavy_faults_end_the_flight_without_an_error() -> None:
    plan = (
        Burst(loss=0.5, mean_ticks=20.0),
        Latency(base_s=1.0, jitter_s=0.5),
        Corrupt(probability=0.1, frame_check=False),
    )
    run = under(*plan, duration_s=150.0)
    assert run.separation.least() >= 0.0


@pytest.mark.parametrize(
    ("latency_s", "loss", "seed"), [(0.5, 0.5, 2), (1.0, 0.3, 1), (1.0, 0.3, 2), (1.0, 0.5, 1)]
)
def test_an_extension_that_is_lost_or_late_costs_no_separation(
    latency_s: float, loss: float, seed: int
) -> None:
    run = under(Loss(probability=loss), Latency(base_s=latency_s), seed=seed)
    assert not run.separation.lost()
    assert run.arrivals.arrivals().totals()["not_arrived"] == ()


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


def test_what_is_lost_is_not_delivered_to_the_node() -> None:
    scenario = msgspec.structs.replace(
        read_scenario("head_on").scenario, fault=(Loss(probability=1.0),)
    )

    class Deaf(BaseNode):
        position_ned_m = (0.0, 0.0, 0.0)

        def step(self, _now_ns: int, inbox: Any) -> list[Message]:
            assert not inbox
            return []

    from tests.support.samples import adsb

    runner = lockstep_runner(Deaf(9, scenario, None, None), scenario)
    message = adsb(1)
    runner.accept(Reception("1/adsb/0", b"", message))
    (report,) = runner.step(10 * TICK_NS)
    assert topic_of(report) == "9/delivery"
    assert RunRecorder(scenario, None).digest == ""
