"""With a radio range: what is out of range is not missing, counts nowhere, and is no link."""

from __future__ import annotations

import dataclasses

import msgspec
import pytest

from fleet import load_scenario
from fleet.analysis.invariants import check
from fleet.analysis.metrics import measure
from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.result import result_of
from fleet.analysis.run_summary import summary_of
from fleet.config.scenario import Scenario, Surveillance, Uav, Zone
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.pause import Pause
from fleet.log.reader import Record
from fleet.protocol import codec
from fleet.protocol.messages import DeliveryReport, Election, StateBroadcast
from fleet.simulation.flying import run
from tests.support.samples import head_on

S = 1_000_000_000
LOST, RECEIVED = "nothing lost silently", "received was sent"
MEETING = head_on(resolver="none", surveillance=Surveillance(range_m=1004.0))
"""UAVs 1 and 2 are within range of each other from 9.92 s to 50.08 s, UAV 3 of nobody."""


@pytest.fixture(scope="module")
def met() -> RecordedRun:
    return run(MEETING)


def altered(flown: RecordedRun, seen_s: float, *, src: int, wanted: int | None) -> RecordedRun:
    """With the entry of UAV 1 for a broadcast left out, or one for another number put in."""
    at = ("1/delivery", round(seen_s * S))
    records = [
        _with(record, src, wanted) if (record.topic, record.sent_ns) == at else record
        for record in flown.records
    ]
    return dataclasses.replace(flown, records=records)


def _with(record: Record, src: int, wanted: int | None) -> Record:
    report = codec.decode(record.topic, record.payload)
    assert isinstance(report, DeliveryReport)
    columns = (
        *(report.src, report.kinds, report.seqs, report.sent_ns),
        *(report.delivered_ns, report.fates),
    )
    rows = [r for r in zip(*columns, strict=True) if r[0] != src]
    if wanted is not None:
        sent_ns = report.t_ns - S // 10
        rows.append((src, StateBroadcast.kind, wanted, sent_ns, report.t_ns, "received"))
    names = ("src", "kinds", "seqs", "sent_ns", "delivered_ns", "fates")
    told = dict(zip(names, zip(*rows, strict=True), strict=True))
    return dataclasses.replace(
        record, payload=codec.encode(msgspec.structs.replace(report, **told))
    )


def test_who_is_out_of_range_does_not_lack_anything(met: RecordedRun) -> None:
    verdicts = check(met)
    assert [f.name for f in verdicts.findings if f.verdict == "invalid"] == []
    # three broadcast 301 times to the coordinator, two 201 times to each other; 151 heartbeats
    elections = sum(isinstance(m, Election) for m in met.messages())
    examined = verdicts.of(LOST).examined
    assert examined == 3 * 301 + 2 * 201 + 3 * 151 + 3 * elections


def test_what_is_within_range_and_in_no_report_is_lost(met: RecordedRun) -> None:
    found = check(altered(met, 20.1, src=2, wanted=None)).of(LOST)
    assert (found.verdict, found.why) == (
        "invalid",
        "UAV 1 never received it, and no fault kept it away",
    )
    assert [w.line() for w in found.witnesses] == ["20.000 s  2/adsb/0_0  seq=100"]


def test_nobody_receives_from_out_of_range(met: RecordedRun) -> None:
    """At 9.8 s the two are 1010 m apart; a heartbeat comes in the same step."""
    found = check(altered(met, 9.7, src=2, wanted=48)).of(RECEIVED)
    assert (found.verdict, found.why) == ("invalid", "UAV 1 is out of its range")


def test_a_broadcast_is_to_the_cell_in_which_its_uav_is(met: RecordedRun) -> None:
    """UAV 1 comes from cell 0_0 to 1_0 when it has flown 1004 m: at 40.16 s."""
    cells = [(r.sent_ns, r.topic) for r in met.records if r.topic.startswith("1/adsb/")]
    assert {topic for t_ns, topic in cells if t_ns <= 40.1 * S} == {"1/adsb/0_0"}
    assert {topic for t_ns, topic in cells if t_ns > 40.1 * S} == {"1/adsb/1_0"}
    records = [
        dataclasses.replace(r, topic="1/adsb/5_5")
        if r.sent_ns == 20 * S and "1/adsb" in r.topic
        else r
        for r in met.records
    ]
    found = check(dataclasses.replace(met, records=records)).of("sent by its issuer")
    assert (found.verdict, found.why) == (
        "invalid",
        "a message on 1/adsb/5_5: its issuer was in cell 0_0",
    )


def test_a_link_lists_what_was_within_range_alone(met: RecordedRun) -> None:
    links = {(m.src, m.dst, m.kind): m for m in measure(met).links}
    assert {(src, dst) for src, dst, kind in links if kind == StateBroadcast.kind} == {
        *((1, 2), (2, 1)),
        *((1, 0), (2, 0), (3, 0)),
    }
    both = [links[1, 2, "adsb"], links[2, 1, "adsb"]]
    assert [(m.sent, m.delivered, m.delivery_ratio) for m in both] == [(201, 201, 1.0)] * 2


def test_a_result_counts_receivers_within_range(met: RecordedRun) -> None:
    told = result_of(summary_of(met), ())["delivery"]["adsb"]
    sent = 3 * 301 + 2 * 201
    assert (told["messages"], told["sent"], told["unreported"]) == (3 * 301, sent, 3)


@pytest.mark.parametrize("electors", ["coordinator", "local"])
def test_runs_with_ranges_and_faults_are_valid(electors: str) -> None:
    settings = {
        "duration_s": 50.0,
        "generate.radius_m": 1200.0,
        "surveillance.range_m": 800.0,
        "coordination.electors": electors,
        "coordination.range_m": 900.0,
    }
    faults = {"loss": "20%", "pause": "2@20s+15s", "kill": "3@10s+15s", "slow": "4:5@20s+30s"}
    flown = run(load_scenario("converge", settings, faults))
    verdicts = check(flown)
    assert (verdicts.overall, [f for f in verdicts.findings if f.verdict == "invalid"]) == (
        "valid",
        [],
    )
    assert result_of(summary_of(flown), flown.plan)["delivery"]["adsb"]["unreported"] >= 0


def test_in_realtime_who_flies_from_cell_to_cell_is_heard_throughout() -> None:
    """Side by side over the edge at 250 m: nothing is lost, before, there or after."""
    side = tuple(
        Uav(n, (150.0, 60.0 * n, -300.0), 0.0, ((9000.0, 60.0 * n, -300.0),)) for n in (1, 2)
    )
    scenario = Scenario(
        "edge",
        8.0,
        resolver="none",
        zone=Zone(radius_m=20.0),
        uav=side,
        surveillance=Surveillance(range_m=250.0),
    )
    flown = run(scenario, bus="zenoh", clock="realtime")
    assert {r.topic for r in flown.records if "1/adsb/" in r.topic} == {"1/adsb/0_0", "1/adsb/1_0"}
    assert [f.name for f in check(flown).findings if f.verdict == "invalid"] == []
    links = {(m.src, m.dst): m for m in measure(flown).links if m.kind == StateBroadcast.kind}
    for link in ((1, 2), (2, 1)):
        assert links[link].sent - links[link].delivered <= 1  # the last one is still on its way


def test_realtime_does_not_blame_who_is_at_the_edge() -> None:
    scenario = msgspec.structs.replace(
        MEETING,
        duration_s=6.0,
        fault=(Loss(probability=0.1), Pause(node="2", start_s=2.0, end_s=3.0)),
    )
    scenario = msgspec.structs.replace(scenario, surveillance=Surveillance(range_m=1350.0))
    flown = run(scenario, bus="zenoh", clock="realtime")
    assert [f.name for f in check(flown).findings if f.verdict == "invalid"] == []
    assert {(m.src, m.dst) for m in measure(flown).links} >= {(1, 2), (2, 1)}
