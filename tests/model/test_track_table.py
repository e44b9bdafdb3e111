"""Tracks as columns: many receivers and reports at once come to the same as one after another."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model.conflict.contact import INCARNATION
from fleet.model.conflict.track_table import ReportColumns, TrackRow, TrackTable
from fleet.model.conflict.tracks import UNHEARD_NS, StateReport, TrackRules, Tracks
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent
from tests.support.samples import MS, S

RULES = TrackRules(
    silence_ns=1500 * MS,
    timeout_ns=8 * S,
    jump_m=100.0,
    max_acceleration_mps2=2.0,
    broadcast_ns=200 * MS,
)
UAVS = (2, 3, 7)
RECEIVERS = 3
PLAN = FlightPlan(((9000.0, 0.0, -300.0),), 0.0)
Cell = tuple[int, int]


@dataclass(frozen=True)
class Heard:
    """What one receiver hears of one UAV in a tick: the report, and whether it is an answer."""

    report: StateReport
    answering: bool


@dataclass(frozen=True)
class Tick:
    """What is heard in a tick, by receiver and UAV, each at a time of its own receiver's clock."""

    local_ns: tuple[int, ...]
    heard: dict[Cell, Heard]


def said(uav: int, seq: int, north_m: float, down_m: float, speed_mps: float) -> StateReport:
    """What a UAV says, by the time of its number."""
    state = State(north_m, 10.0 * uav, down_m, speed_mps, 0.3)
    t_ns = seq % INCARNATION * RULES.broadcast_ns
    return StateReport(uav, t_ns, state, Intent(0.0, 0.0, -300.0), PLAN, seq=seq)


@st.composite
def ticks(draw: st.DrawFn) -> list[Tick]:
    """Some is lost, late, repeated or incredible, and a UAV may have been started again."""
    out, seqs = [], dict.fromkeys(UAVS, 0)
    for n in range(draw(st.integers(1, 25))):
        heard = {}
        for uav in UAVS:
            seqs[uav] += draw(st.sampled_from((1, 1, 1, 2, 9, 60, 0)))
            if draw(st.integers(0, 20)) == 0:
                seqs[uav] = (seqs[uav] // INCARNATION + 1) * INCARNATION
            for receiver in range(RECEIVERS):
                back = draw(st.sampled_from((0, 0, 0, 0, 1, 3)))
                seq = max(0, seqs[uav] - back)
                far_m = draw(st.sampled_from((0.0, 0.0, 0.0, 90.0, 5000.0)))
                down_m = draw(st.sampled_from((-300.0, -300.0, -150.0)))
                speed_mps = draw(st.sampled_from((25.0, 25.0, 30.0, 60.0)))
                north_m = 5.0 * (seq % INCARNATION) + far_m
                if draw(st.integers(0, 3)):
                    report = said(uav, seq, north_m, down_m, speed_mps)
                    heard[receiver, uav] = Heard(report, draw(st.booleans()))
        shifts = [draw(st.sampled_from((0, 0, 5 * MS))) for _ in range(RECEIVERS)]
        out.append(Tick(tuple(n * 200 * MS + s for s in shifts), heard))
    return out


def take_together(table: TrackTable, rows: list[TrackRow], tick: Tick) -> list[bool]:
    cells = list(tick.heard)
    reports = [tick.heard[c].report for c in cells]
    items = np.empty(len(cells), dtype=object)
    items[:] = reports
    states = [(r.state.north_m, r.state.east_m, r.state.down_m, r.state.speed_mps) for r in reports]
    columns = ReportColumns(
        np.array([r.seq for r in reports], dtype=np.int64),
        np.array([r.t_ns for r in reports], dtype=np.int64),
        np.array(states).reshape(-1, 4),
        items,
    )
    believed = table.take(
        np.array([rows[receiver].receiver for receiver, _ in cells], dtype=np.int64),
        np.array([table.column[uav] for _, uav in cells], dtype=np.int64),
        np.arange(len(cells)),
        columns,
        local_ns=np.array([tick.local_ns[receiver] for receiver, _ in cells], dtype=np.int64),
        answering=np.array([tick.heard[c].answering for c in cells], dtype=np.bool_),
    )
    return [bool(b) for b in believed]


def assert_alike(row: TrackRow, tracks: Tracks, now_ns: int) -> None:
    assert row.current(now_ns) == tracks.current(now_ns)
    assert row.silent(now_ns) == tracks.silent(now_ns)
    assert row.present(now_ns) == tracks.present(now_ns)
    choices: list[Collection[int] | None] = [None, (2,), (3, 7)]
    for some in choices:
        assert row.hears_any(some, now_ns) == tracks.hears_any(some, now_ns)
    for uav in UAVS:
        assert row.limit_ns(uav) == tracks.limit_ns(uav)
        assert row.answered_ns(uav) == tracks.answered_ns(uav)
        assert row.share((uav, 99)) == tracks.share((uav, 99))


@pytest.mark.parametrize("together", [True, False])
@given(flown=ticks())
@settings(deadline=None, derandomize=True, max_examples=150)
def test_a_table_knows_what_tracks_know_of_the_same_reports(
    together: bool, flown: list[Tick]
) -> None:
    table = TrackTable(RECEIVERS + 1, UAVS, RULES, lambda _: pytest.fail("all are read already"))
    rows = [table.row(n + 1) for n in range(RECEIVERS)]
    tracks = [Tracks(RULES) for _ in range(RECEIVERS)]
    for tick in flown:
        expected = [
            tracks[r].hear(h.report, tick.local_ns[r], answering=h.answering)
            for (r, _), h in tick.heard.items()
        ]
        if together and tick.heard:
            assert take_together(table, rows, tick) == expected
        else:
            assert expected == [
                rows[r].hear(h.report, tick.local_ns[r], answering=h.answering)
                for (r, _), h in tick.heard.items()
            ]
        for row, known in zip(rows, tracks, strict=True):
            for later_ns in (0, 1500 * MS, 1501 * MS, 6 * S, 9 * S):
                assert_alike(row, known, max(tick.local_ns) + later_ns)


def test_a_receiver_that_is_started_again_knows_nothing_and_the_others_what_they_knew() -> None:
    table = TrackTable(2, UAVS, RULES, lambda _: pytest.fail("all are read already"))
    one, two = table.row(0), table.row(1)
    for row in (one, two):
        row.hear(said(2, 0, 0.0, -300.0, 25.0), 0, answering=True)
        assert not row.hear(said(2, 1, 9000.0, -300.0, 25.0), 200 * MS), "doubted"
    again = table.row(0)
    assert again.current(0) == []
    assert again.answered_ns(2) == UNHEARD_NS
    assert not again.hears_any(None, 0)
    assert again.hear(said(2, 2, 9000.0, -300.0, 25.0), 400 * MS), "the first is believed"
    assert [r.seq for r in two.current(0)] == [0]


def test_what_is_kept_is_read_when_it_is_asked_for() -> None:
    message = msgspec.structs.replace(said(3, 0, 0.0, -300.0, 25.0), hears=False)
    table = TrackTable(1, UAVS, RULES, lambda item: item[0])
    items = np.empty(1, dtype=object)
    items[0] = [message]
    zero = np.zeros(1, dtype=np.int64)
    heard = ReportColumns(zero, zero, np.array([[0.0, 0.0, -300.0, 25.0]]), items)
    row = table.row(0)
    table.take(zero, zero + 1, zero, heard, local_ns=zero, answering=np.array([False]))
    assert row.current(0) == [message]
