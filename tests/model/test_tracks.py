"""Tracks: what is believed of what was heard, for how long, and what silence means."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fleet.model.conflict.contact import INCARNATION
from fleet.model.conflict.tracks import (
    BELIEVED_AFTER,
    ActiveManoeuvre,
    CommandId,
    StateReport,
    TrackRules,
    Tracks,
    plausible,
    states_at,
)
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent
from tests.support.samples import MS, S, head_on

RULES = TrackRules(
    silence_ns=1500 * MS,
    timeout_ns=60 * S,
    jump_m=100.0,
    max_acceleration_mps2=2.0,
    broadcast_ns=200 * MS,
)
PERIOD_NS = 200 * MS
fast = settings(deadline=None, derandomize=True, max_examples=200)


def report(seq: int, north_m: float | None = None, uav: int = 1, **changes: Any) -> StateReport:
    """Broadcast number `seq` of a UAV that flies north at 25 m/s, or says that it is elsewhere."""
    t_ns = seq % INCARNATION * PERIOD_NS
    north_m = 25.0 * t_ns / S if north_m is None else north_m
    state = State(north_m, 0.0, -300.0, changes.pop("speed_mps", 25.0), 0.0)
    plan = FlightPlan(((9000.0, 0.0, -300.0),), 0.0)
    made = StateReport(uav, t_ns, state, Intent(0.0, 0.0, -300.0), plan, seq=seq)
    return msgspec.structs.replace(made, **changes)


def tracks(*heard: StateReport) -> Tracks:
    """All heard when they were sent."""
    made = Tracks(RULES)
    for item in heard:
        made.hear(item, item.t_ns)
    return made


def only(made: Tracks, now_ns: int) -> StateReport:
    (found,) = made.current(now_ns)
    return found


def last_heard(made: Tracks, since_ns: int) -> bool:
    """Whether UAV 1 was last heard then: its silence counts from that moment."""
    end_ns = since_ns + made.limit_ns(1)
    return made.silent(end_ns) == frozenset() and made.silent(end_ns + 1) == {1}


# Order


@given(st.lists(st.integers(0, 40), min_size=1, max_size=20))
@fast
def test_an_older_report_never_replaces_a_newer_one(order: list[int]) -> None:
    made = Tracks(RULES)
    for n, seq in enumerate(order):
        assert made.hear(report(seq), n)
        assert only(made, n) == report(max(order[: n + 1]))


@given(st.lists(st.integers(0, 40), min_size=1, max_size=20))
@fast
def test_a_replay_is_no_sign_of_life(order: list[int]) -> None:
    """Heard is a UAV when something comes that is newer than all before."""
    made = Tracks(RULES)
    newest, since_ns = -1, 0
    for n, seq in enumerate(order):
        now_ns = n * S
        made.hear(report(seq), now_ns)
        if seq > newest:
            newest, since_ns = seq, now_ns
        assert last_heard(made, since_ns)


def test_replays_for_ever_leave_a_uav_silent_and_then_forgotten() -> None:
    made = tracks(*[report(n) for n in range(10)])
    last_ns = report(9).t_ns
    for now_ns in range(last_ns, last_ns + 70 * S, PERIOD_NS):
        made.hear(report(9), now_ns)
        assert (1 in made.silent(now_ns)) == (now_ns > last_ns + RULES.silence_ns)
        assert bool(made.current(now_ns)) == (now_ns <= last_ns + RULES.timeout_ns)


# Silence


def turning(uav: int = 1) -> StateReport:
    """In a climbing turn to the east, by command."""
    made = report(0, uav=uav, manoeuvre=ActiveManoeuvre("turn_climb", math.pi / 2, 3.0))
    made = msgspec.structs.replace(made, command_id=CommandId(4, 2, 1), mandate_term=4)
    return msgspec.structs.replace(made, state=State(0.0, 0.0, -300.0, 25.0, 0.7, 0.1))


def test_a_silent_uav_is_taken_to_fly_straight_on_and_level() -> None:
    made = tracks(turning())
    assert only(made, RULES.silence_ns) == turning()
    silent = only(made, RULES.silence_ns + 1)
    assert (silent.manoeuvre, silent.command_id) == (None, CommandId())
    assert (silent.intent().heading_rad, silent.intent().climb_mps) == (0.7, 0.0)
    assert silent.plan.arrived
    assert silent.state == turning().state
    later = states_at([silent], 30 * S, head_on().models())[0]
    assert later.heading_rad == pytest.approx(0.7)
    assert later.north_m == pytest.approx(25.0 * 30.0 * math.cos(0.7), abs=2.0)
    assert later.east_m == pytest.approx(25.0 * 30.0 * math.sin(0.7), abs=2.0)


def test_only_those_who_are_silent_are_taken_so() -> None:
    made = Tracks(RULES)
    made.hear(turning(1), 0)
    made.hear(turning(2), 2 * S)
    one, two = made.current(2 * S)
    assert (one.manoeuvre, two.manoeuvre) == (None, turning().manoeuvre)
    assert made.silent(2 * S) == {1}


def test_who_is_heard_again_is_no_longer_silent() -> None:
    made = tracks(report(0))
    assert made.silent(5 * S) == {1}
    made.hear(report(25), 5 * S)
    assert made.silent(5 * S) == frozenset()
    assert only(made, 5 * S) == report(25)


@pytest.mark.parametrize(("past_ns", "count"), [(0, 1), (1, 0)])
def test_a_track_is_dropped_after_the_time_out(past_ns: int, count: int) -> None:
    assert len(tracks(report(0)).current(RULES.timeout_ns + past_ns)) == count


@given(
    st.dictionaries(st.integers(1, 9), st.integers(0, 70 * S), max_size=8), st.integers(0, 80 * S)
)
@fast
def test_who_is_there_and_who_is_silent_follows_from_when_each_was_heard(
    heard: dict[int, int], later_ns: int
) -> None:
    made = Tracks(RULES)
    for uav, t_ns in heard.items():
        made.hear(turning(uav), t_ns)
    now_ns = max([later_ns, *heard.values()])
    quiet = {uav: now_ns - t_ns for uav, t_ns in heard.items()}
    current = made.current(now_ns)
    assert [r.id for r in current] == sorted(u for u, q in quiet.items() if q <= 60 * S)
    assert made.silent(now_ns) == {u for u, q in quiet.items() if q > 1500 * MS}
    assert {r.id for r in current if r.manoeuvre} == {u for u, q in quiet.items() if q <= 1500 * MS}


# Plausibility


FAR = 5000.0


def test_an_implausible_jump_is_not_believed_and_no_sign_of_life() -> None:
    made = tracks(report(0))
    assert not made.hear(report(1, FAR), PERIOD_NS)
    assert only(made, PERIOD_NS) == report(0)
    assert last_heard(made, 0)
    assert made.hear(report(2), 2 * PERIOD_NS)
    assert only(made, 2 * PERIOD_NS) == report(2)


def test_who_insists_consistently_is_believed() -> None:
    made = tracks(report(0))
    jumped = [report(n, FAR + 5.0 * n) for n in range(1, BELIEVED_AFTER + 2)]
    believed = [made.hear(r, r.t_ns) for r in jumped]
    assert BELIEVED_AFTER == 3
    assert believed == [False, False, True, True]
    assert only(made, jumped[-1].t_ns) == jumped[-1]
    assert last_heard(made, jumped[-1].t_ns)


def test_who_contradicts_itself_is_never_believed() -> None:
    made = tracks(report(0))
    for n in range(1, 20):
        wild = report(n, FAR if n % 2 else -FAR)
        assert not made.hear(wild, wild.t_ns)
    assert only(made, report(19).t_ns).state == report(0).state


def test_a_true_report_between_makes_insistence_begin_anew() -> None:
    made = tracks(report(0))
    run_data = [(1, FAR), (2, FAR), (3, None), (4, FAR), (5, FAR), (6, FAR)]
    assert [made.hear(report(n, at), n * PERIOD_NS) for n, at in run_data] == [
        False, False, True, False, False, True,
    ]  # fmt: skip


def test_the_same_implausible_report_again_is_no_insistence() -> None:
    made = tracks(report(0))
    wild = report(1, FAR)
    assert [made.hear(wild, n * PERIOD_NS) for n in range(1, 9)] == 8 * [False]


def test_the_doubts_about_one_uav_are_not_those_about_another() -> None:
    made = tracks(report(0, uav=1), report(0, uav=2))
    for n in (1, 2):
        for uav in (1, 2):
            assert not made.hear(report(n, FAR, uav=uav), n * PERIOD_NS)
    assert made.hear(report(3, FAR, uav=2), 3 * PERIOD_NS)
    assert [r.seq for r in made.current(3 * PERIOD_NS)] == [0, 3]


@pytest.mark.parametrize(
    ("new", "believed"),
    [
        (report(1, 5.0 + 99.0), True),
        (report(1, 5.0 + 101.0), False),
        (report(1, 5.0 - 109.0), True),
        (report(1, 5.0 - 111.0), False),
        (report(100, 25.0 * 20.0 + 99.0), True),  # 20 s later
        (report(100, 25.0 * 20.0 + 101.0), False),
        (report(100, -25.0 * 20.0 - 99.0), True),  # it may have turned
        (report(1, speed_mps=25.0 + 10.3), True),
        (report(1, speed_mps=25.0 + 10.5), False),
        (report(1, speed_mps=25.0 - 10.5), False),
        (report(100, speed_mps=60.0), True),
        (report(1, t_ns=0), True),  # its clock may stand still, or run backwards
        (report(1, 99.0, t_ns=0), True),
        (report(1, 101.0, t_ns=0), False),
    ],
)
def test_what_a_uav_can_have_flown_is_believed(new: StateReport, believed: bool) -> None:
    assert plausible(report(0), new, RULES) is believed
    assert tracks(report(0)).hear(new, PERIOD_NS) is believed


@given(
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 60.0),
    st.floats(-30.0, 30.0),
    st.floats(0.0, 99.0),
    st.floats(-math.pi, math.pi),
    st.integers(1, 600),
)
@fast
def test_whoever_flies_within_its_limits_is_believed_with_any_error_below_the_jump(
    heading_rad: float, turned_s: float, gained: float, error_m: float, at_rad: float, later: int
) -> None:
    """Straight on, at a speed within its acceleration, sensed anywhere within `jump_m`."""
    elapsed_s = later * PERIOD_NS / S
    assume(abs(gained) <= 2.0 * elapsed_s and 25.0 + gained > 0.0)
    speed = 25.0 + gained
    flown_m = min(25.0, speed) * min(turned_s, elapsed_s)
    state = State(
        flown_m * math.cos(heading_rad) + error_m * math.cos(at_rad),
        flown_m * math.sin(heading_rad) + error_m * math.sin(at_rad),
        -300.0,
        speed,
        heading_rad,
    )
    assert plausible(report(0), report(later, state=state), RULES)


# Sequence


@pytest.mark.parametrize(
    ("known", "new", "believed"),
    [
        (5, 6, True),
        (5, 56, True),  # some more than there can have been: clocks err
        (5, 57, False),
        (5, INCARNATION - 1, False),  # nobody can have sent so many
        (5, INCARNATION, True),  # started again
        (INCARNATION + 7, 2 * INCARNATION, True),
        (5, 9 * INCARNATION + 3, True),
        (5, 10 * INCARNATION, False),
        (5, 2**52, False),
        (3 * INCARNATION, 3 * INCARNATION + 20_000, False),
    ],
)
def test_so_many_broadcasts_and_restarts_as_can_have_been_are_believed(
    known: int, new: int, believed: bool
) -> None:
    first = report(known, 0.0, t_ns=0)
    second = report(new, 5.0, t_ns=PERIOD_NS)
    assert plausible(first, second, RULES) is believed


def test_a_corrupted_number_does_not_deafen_for_ever() -> None:
    """Believed, it would make all that follow look old."""
    made = tracks(report(0))
    wrong = msgspec.structs.replace(report(1), seq=2**40)
    assert not made.hear(wrong, PERIOD_NS)
    assert made.hear(report(2), 2 * PERIOD_NS)


def test_a_uav_that_is_started_again_is_believed_where_it_was_expected_at_once() -> None:
    made = tracks(*[report(n) for n in range(50)])
    revived = report(INCARNATION, 25.0 * 20.0, t_ns=20 * S)
    assert made.hear(revived, 20 * S)
    assert not made.silent(20 * S)
    stale = report(50)
    assert made.hear(stale, 20 * S)
    assert only(made, 20 * S) == revived
