"""What the page draws is what is on record, at every time and in whatever order it is asked for."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.analysis.recorded_run import RecordCollector, RecordedRun
from fleet.config.loading import load_scenario
from fleet.live.history import History
from fleet.live.log_source import LogSource
from fleet.live.source import Change
from fleet.live.view import EVENTS_SHOWN, LiveView
from fleet.protocol import codec
from fleet.protocol.messages import (
    Ack,
    Command,
    DeliveryReport,
    Election,
    Message,
    Truth,
)
from fleet.protocol.topics import topic_of
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.live_feed import LinkCount, LiveFrame
from fleet.simulation.run_recorder import RunRecorder

ViewData = dict[str, Any]


@pytest.fixture(scope="module")
def run() -> RecordedRun:
    scenario = load_scenario("four_way", {"duration_s": 80.0}, {"loss": "30%", "kill": "2@40s+20s"})
    sink = RecordCollector()
    for _ in run_in_memory(scenario, RunRecorder(scenario, sink)):
        pass
    return RecordedRun.of_records(scenario, sink.kept)


@pytest.fixture(scope="module")
def said(run: RecordedRun) -> list[Message]:
    told = [r for r in run.records if not r.topic.startswith("sim/")]
    return [codec.decode(r.topic, r.payload) for r in told]


def at(source: LogSource, view: LiveView, time_s: float) -> ViewData:
    source.change(Change(to_s=time_s, paused=True))
    view.forget_events()
    frame = source.frame(0)
    assert frame is not None
    return view.take(frame)


def test_aircraft_are_where_they_truly_were(run: RecordedRun, said: list[Message]) -> None:
    source, view = LogSource(run, "log"), LiveView(run.scenario, recorded=True)
    for time_s in (79.9, 12.3, 50.0, 0.0):
        shown = at(source, view, time_s)
        wanted = {m.id: m for m in said if isinstance(m, Truth) and m.t_ns <= round(1e9 * time_s)}
        assert {u["id"] for u in shown["uavs"]} == wanted.keys()
        for uav in shown["uavs"]:
            assert uav["ned_m"] == pytest.approx(wanted[uav["id"]].position_ned_m, abs=0.01)
            assert uav["mode"] == wanted[uav["id"]].mode
    assert at(source, view, 50.0)["down"] == [2]
    assert at(source, view, 70.0)["down"] == []


def test_what_was_flown_before_a_moment_of_a_log_is_told(
    run: RecordedRun, said: list[Message]
) -> None:
    view = LiveView(run.scenario, recorded=True)
    source = LogSource(run, "log")
    history = History(source, view)
    early, now, late = (at(source, view, time_s) for time_s in (20.0, 70.5, 80.0))
    told = history.between(None, now)
    assert [moment["t_s"] for moment in told] == [*range(71)]
    assert [bool(moment["uavs"]) for moment in told] == [t_s >= 10.5 for t_s in range(71)]
    flown = {(m.id, m.t_ns): m.position_ned_m for m in said if isinstance(m, Truth)}
    for moment in told[11:]:
        assert [uav["id"] for uav in moment["uavs"]] == [1, 2, 3, 4]
        for uav in moment["uavs"]:
            place = flown[uav["id"], round(1e9 * moment["t_s"])]
            assert uav["ned_m"] == pytest.approx(place, abs=0.01)
    assert told[20]["pairs"] == early["pairs"]
    assert history.between(now, late) == history.between(None, late)[71:]
    assert history.between(late, now) == told  # gone back


def test_the_nearest_pairs_come_first_by_what_is_required(run: RecordedRun) -> None:
    shown = at(LogSource(run, "log"), LiveView(run.scenario, recorded=True), 70.0)
    places = {u["id"]: np.array(u["ned_m"]) for u in shown["uavs"]}
    apart = sorted(
        max(math.hypot(*(places[i] - places[j])[:2]) / 400, abs(places[i][2] - places[j][2]) / 50)
        for i in places
        for j in places
        if i < j
    )
    assert [p["apart"] for p in shown["pairs"]] == pytest.approx(apart, abs=2e-3)


def test_each_aircraft_has_its_own_zone() -> None:
    own = {"uav.2.zone.radius_m": 350.0, "uav.2.zone.half_height_m": 40.0}
    about = LiveView(load_scenario("head_on", own)).about(title="", read_only=True)
    zones = [(u["radius_m"], u["half_height_m"]) for u in about["uavs"]]
    assert zones == [(200.0, 25.0), (350.0, 40.0)]


def test_who_computes_for_whom_is_the_latest_election(
    run: RecordedRun, said: list[Message]
) -> None:
    shown = at(LogSource(run, "log"), LiveView(run.scenario, recorded=True), 45.0)
    elections = [m for m in said if isinstance(m, Election) and m.t_ns <= 45_000_000_000]
    latest = max(elections, key=lambda m: m.term)
    first = shown["groups"][0]
    assert (first["term"], first["computing"]) == (latest.term, latest.computing)
    assert first["fresh"]


def election(term: int, issuer: int, computing: int, until_s: int, *members: int) -> Election:
    return Election(issuer, term, 0, term, members[0], members, computing, until_s * 10**9)


def groups_at(time_s: int, *elections: Election) -> list[tuple[int, int, int, bool, bool]]:
    states = tuple((topic_of(e), codec.encode(e)) for e in elections)
    frame = LiveFrame(0, time_s * 10**9, states, (), (), "", (), ())
    shown = LiveView(load_scenario("head_on")).take(frame)["groups"]
    return [(g["term"], g["elector"], g["computing"], g["fresh"], g["rivals"]) for g in shown]


def test_all_elections_in_force_are_shown_and_rivals_side_by_side() -> None:
    elections = (
        election(1, 1, 1, 22, 1, 2, 3, 4),
        election(2, 5, 5, 22, 5, 6),
        election(3, 3, 3, 22, 1, 2, 3, 4),
        election(9, 0, 2, 9, 1, 2, 3, 4),
        election(8, 0, 7, 9, 7, 8),
    )
    now = [(3, 3, 3, True, True), (1, 1, 1, True, True), (2, 5, 5, True, False)]
    assert groups_at(20, *elections) == [*now, (8, 0, 7, False, False)]
    past = [(9, 0, 2, False, False), (8, 0, 7, False, False), (2, 5, 5, False, False)]
    assert groups_at(30, *elections) == past


def test_no_election_in_force_is_left_out_however_many_there_are() -> None:
    many = [election(n, 0, 2 * n, 22, 2 * n, 2 * n + 1) for n in range(1, 31)]
    assert [row[0] for row in groups_at(20, *many)] == list(range(30, 0, -1))


def test_rival_computing_uavs_are_shown_from_a_log_and_told_once() -> None:
    """Two sides of a partition elect for the same UAVs, after the coordinator has died."""
    cut = {"latency": "300ms", "loss": "20%", "kill": "coordinator@30s"}
    faults = cut | {"partition": "1-2/3,4,coordinator@30s"}
    scenario = load_scenario("four_way", {"duration_s": 50.0}, faults)
    sink = RecordCollector()
    for _ in run_in_memory(scenario, RunRecorder(scenario, sink)):
        pass
    said = [codec.decode(r.topic, r.payload) for r in sink.kept if "/election" in r.topic]
    elections = [m for m in said if isinstance(m, Election)]
    source = LogSource(RecordedRun.of_records(scenario, sink.kept), "log")
    shown = at(source, LiveView(scenario, recorded=True), 45.0)
    wanted = {(m.term, m.computing) for m in elections if m.t_ns <= 45 * 10**9 < m.valid_until_ns}
    assert len({computing for _, computing in wanted}) > 1
    assert {(g["term"], g["computing"]) for g in shown["groups"] if g["fresh"]} == wanted
    told = [e["text"] for e in shown["events"] if e["kind"] == "election"]
    assert len(told) == len(set(told))


def test_each_event_is_told_once_and_the_last_ones_are_kept(
    run: RecordedRun, said: list[Message]
) -> None:
    shown = at(LogSource(run, "log"), LiveView(run.scenario, recorded=True), 80.0)
    terms = {m.term for m in said if isinstance(m, Election)}
    others = sum(isinstance(m, Command | Ack) for m in said)
    assert len(shown["events"]) == min(EVENTS_SHOWN, len(terms) + others)
    assert [e["n"] for e in shown["events"]] == sorted(e["n"] for e in shown["events"])
    assert sum(e["kind"] == "election" for e in shown["events"]) <= len(terms)


def test_links_tell_what_was_lost_of_the_last_seconds(
    run: RecordedRun, said: list[Message]
) -> None:
    source, view = LogSource(run, "log"), LiveView(run.scenario, recorded=True)
    at(source, view, 79.0)
    shown = at(source, view, 30.0)  # wherever one has been before
    reports = [m for m in said if isinstance(m, DeliveryReport) and m.id == 3]
    counted = [
        bool(got)
        for report in reports
        for src, got in zip(report.src, report.delivered_ns, strict=True)
        if src == 1 and 25_000_000_000 < report.t_ns <= 30_000_000_000
    ]
    (row,) = [link for link in shown["links"] if link[:2] == [1, 3]]
    assert row[4] == pytest.approx(len(counted), abs=3)  # kept every half second
    assert row[2] == pytest.approx(1.0 - sum(counted) / len(counted), abs=0.1)
    assert 0.05 < row[3] <= 0.2


def counted(t_ns: int, received: int, lost: int) -> LiveFrame:
    links = (LinkCount(1, 2, received, lost, 0),)
    return LiveFrame(t_ns // 10**8, t_ns, (), (), links, "", (), ())


def test_what_links_did_before_anybody_looked_is_not_told() -> None:
    view = LiveView(load_scenario("head_on"))
    assert view.take(counted(90 * 10**9, 10_000, 0))["links"] == []
    assert view.take(counted(91 * 10**9, 10_000, 20))["links"] == [[1, 2, 1.0, 0.0, 20]]


def test_a_run_that_is_paused_for_long_takes_no_memory() -> None:
    view = LiveView(load_scenario("head_on"))
    view.take(counted(0, 0, 0))
    for n in range(1, 200):
        view.take(counted(10**9, n, 0))
    assert len(view._links) == 2


def test_of_a_log_only_the_last_events_are_gone_through(
    run: RecordedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fleet.live.log_source.EVENTS_KEPT", 3)
    source = LogSource(run, "log")
    source.change(Change(to_s=80.0, paused=True))
    frame = source.frame(0)
    assert frame is not None
    last = frame.events[-1][0]
    assert [event[0] for event in frame.events] == [last - 2, last - 1, last]
    again = source.frame(last - 1)
    assert again is not None
    assert [event[0] for event in again.events] == [last]


def test_what_came_late_is_shown_from_when_it_came() -> None:
    scenario = load_scenario("head_on", {"duration_s": 5.0})
    sink = RecordCollector()
    for _ in run_in_memory(scenario, RunRecorder(scenario, sink)):
        pass
    late = [
        replace(r, log_ns=r.log_ns + 10**9) if r.topic == "2/truth" else r
        for r in sink.kept
        if not r.topic.startswith("sim/")
    ]
    late.sort(key=lambda record: record.log_ns)
    source = LogSource(RecordedRun.of_records(scenario, late), "log")
    source.change(Change(to_s=3.0, paused=True))
    frame = source.frame(0)
    assert frame is not None
    truths = [m for m in (codec.decode(*s) for s in frame.states) if isinstance(m, Truth)]
    assert {m.id: m.t_ns for m in truths} == {1: 3 * 10**9, 2: 2 * 10**9}


def test_a_log_plays_at_its_speed_and_goes_anywhere(
    run: RecordedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 100.0
    monkeypatch.setattr("fleet.live.log_source.time.monotonic", lambda: now_s)
    source = LogSource(run, "log")

    def shown_s() -> float:
        frame = source.frame(0)
        assert frame is not None
        return frame.t_ns / 1e9

    now_s += 2.0
    assert shown_s() == 2.0
    assert source.change(Change(speed=5.0)).good
    now_s += 2.0
    assert shown_s() == 12.0
    assert source.change(Change(paused=True)).good
    now_s += 100.0
    assert shown_s() == 12.0
    assert source.change(Change(steps=3)).good
    assert shown_s() == pytest.approx(12.3)
    for far_s, end_s in ((1e9, 80.0), (-1e308, 0.0), (1e308, 80.0)):
        assert source.change(Change(to_s=far_s)).good
        assert shown_s() == end_s
    assert not source.change(Change(speed=0.0)).good
    assert not source.change(Change(faults={"loss": ["30%"]})).good


def test_a_whole_frame_has_the_scenario_of_the_log(run: RecordedRun, tmp_path: Path) -> None:
    assert tmp_path.exists()
    from fleet.live.view import scenario_of

    frame = LogSource(run, "log").frame(0, whole=True)
    assert frame is not None
    assert scenario_of(frame) == run.scenario
