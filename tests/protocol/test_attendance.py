"""What can be a participant's own in a realtime run in which processes stop, die and come back."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis.invariants.fates import fates_of
from fleet.analysis.invariants.index import Index
from fleet.faults.kinds.kill import Kill
from fleet.log.reader import Record
from fleet.model.conflict.contact import INCARNATION
from fleet.protocol.attendance import LAST_WORDS_NS, Attendance
from fleet.protocol.codec import encode
from fleet.protocol.messages import Clock
from fleet.protocol.topics import CLOCK
from tests.analysis.test_check_story import RecordedRunBuilder, apart
from tests.support.samples import MS, S

TICK_NS = 100 * MS
SAID_LATE_NS = 5 * MS
"""So long after its tick the simulation has carried it out."""


def told(*grants: Clock) -> Attendance:
    made = Attendance(TICK_NS)
    for grant in grants:
        made.hear(grant, grant.t_ns + SAID_LATE_NS)
    return made


def plan(t_ns: int, held: tuple[int, ...] = (), down: tuple[int, ...] = ()) -> Clock:
    return Clock(t_ns // TICK_NS, t_ns, "plan", {}, held=held, down=down)


KILLED = (plan(S, down=(1,)),)
REBORN = (*KILLED, plan(3 * S))
STOPPED = (plan(S, held=(1,)),)
RESUMED = (*STOPPED, plan(3 * S))
KILLED_STOPPED = (*STOPPED, plan(2 * S, down=(1,)))
STOPPED_AT_BIRTH = (*KILLED, plan(3 * S, held=(1,)), plan(4 * S))

CASES: list[tuple[str, tuple[Clock, ...], int, int, int, str]] = [
    # who is away, number, sent, arrived, why not
    ("alive", (), 0, S, S, ""),
    ("its last word, on its way", KILLED, 0, S, S + 50 * MS, ""),
    ("sent before the kill was carried out", KILLED, 0, S + SAID_LATE_NS, S + 50 * MS, ""),
    ("sent after it", KILLED, 0, S + SAID_LATE_NS + 1, S + 50 * MS, "away"),
    ("long on its way", KILLED, 0, S, S + SAID_LATE_NS + LAST_WORDS_NS, ""),
    ("too long", KILLED, 0, S, S + SAID_LATE_NS + LAST_WORDS_NS + 1, "away"),
    ("another's", (plan(S, down=(2,)),), 0, 2 * S, 2 * S, ""),
    ("before it is started again", KILLED, INCARNATION, 2 * S, 2 * S, "away"),
    ("as of before it was started again", REBORN, INCARNATION, 2 * S, 4 * S, "away"),
    ("in its new incarnation", REBORN, INCARNATION, 3 * S, 4 * S, ""),
    ("numbered as in its incarnation before", REBORN, 0, 3 * S, 4 * S, "away"),
    ("its last word, when it is alive again", REBORN, 0, S, 3 * S + 1, ""),
    ("of an incarnation that has not begun", REBORN, 2 * INCARNATION, 4 * S, 4 * S, "out of order"),
    ("not the first of its incarnation", REBORN, INCARNATION + 1, 4 * S, 4 * S, "out of order"),
    ("stopped", STOPPED, 0, 2 * S, 2 * S, "away"),
    ("stopped, its last word", STOPPED, 0, S, S + 50 * MS, ""),
    ("a step that it was late with", RESUMED, 0, 2 * S, 3 * S + 1, ""),
    ("killed while it was stopped", KILLED_STOPPED, 0, 2 * S, 2 * S + 50 * MS, "away"),
    ("killed while it was stopped, earlier", KILLED_STOPPED, 0, S, 2 * S + 50 * MS, ""),
    (
        "started again and stopped",
        STOPPED_AT_BIRTH[:2],
        INCARNATION,
        3 * S + 50 * MS,
        4 * S,
        "away",
    ),
    ("started again, stopped and gone on", STOPPED_AT_BIRTH, INCARNATION, 4 * S, 4 * S, ""),
    (
        "an epoch lists nobody",
        (*KILLED, Clock(20, 2 * S, "epoch", {})),
        INCARNATION,
        2 * S,
        3 * S,
        "away",
    ),
]


@pytest.mark.parametrize(
    ("grants", "seq", "t_ns", "arrived_ns", "why"),
    [case[1:] for case in CASES],
    ids=[case[0] for case in CASES],
)
def test_nothing_comes_from_who_is_away(
    grants: tuple[Clock, ...], seq: int, t_ns: int, arrived_ns: int, why: str
) -> None:
    assert told(*grants).refusal(1, "adsb", seq, t_ns, arrived_ns) == why


@pytest.mark.parametrize("seq", [10, 20, 40])
def test_a_true_state_is_of_the_incarnation_of_its_time(seq: int) -> None:
    """It is numbered by ticks, in all lives."""
    t_ns, expected = seq * TICK_NS, {10: "", 20: "away", 40: ""}
    assert told(*REBORN).refusal(1, "truth", seq, t_ns, 4 * S) == expected[seq]
    assert told(*REBORN).incarnation_of(1, "truth", seq, t_ns) == (seq == 40)


def answers(*messages: tuple[str, int, int]) -> list[str]:
    attendance = told()
    return [attendance.refusal(1, kind, seq, t, 9 * S) for kind, seq, t in messages]


def test_numbers_of_a_class_have_no_gap_and_times_do_not_go_back() -> None:
    assert answers(("cmd", 0, S), ("ack", 0, 0), ("cmd", 1, S)) == ["", "", ""]
    for wrong in (("cmd", 0, S), ("cmd", 2, S), ("cmd", 1, S - 1)):
        assert answers(("cmd", 0, S), wrong) == ["", "out of order"]
    assert answers(("cmd", 1, S)) == ["out of order"]


def test_true_states_can_be_missed_and_are_of_their_tick() -> None:
    assert answers(("truth", 0, 0), ("truth", 7, 7 * TICK_NS)) == ["", ""]
    assert answers(("truth", 500, 2600 * MS)) == ["out of order"]
    for seq in (2, 3):
        twice = answers(("truth", 3, 3 * TICK_NS), ("truth", seq, seq * TICK_NS))
        assert twice == ["", "out of order"]


moments = st.integers(0, 100)


@given(st.lists(st.tuples(moments, st.sampled_from(["up", "held", "down"])), max_size=8))
@settings(deadline=None, derandomize=True, max_examples=200)
def test_whatever_becomes_of_a_process_its_own_messages_are_its_own(
    changed: list[tuple[int, str]],
) -> None:
    """One that sends at once in every tick in which it runs, as late as the simulation may be."""
    attendance, now, incarnation, seq = Attendance(TICK_NS), "up", 0, 0
    changes = dict(changed)
    for tick in range(102):
        t_ns = tick * TICK_NS
        before, now = now, changes.get(tick, now)
        racing = before == "up"  # it may step before the simulation has stopped it
        if before != now:
            held, down = ((1,) if now == state else () for state in ("held", "down"))
            attendance.hear(plan(t_ns, held, down), t_ns + SAID_LATE_NS)
        if before == "down" != now:
            incarnation, seq = incarnation + 1, 0
        if now == "up" or racing:
            why = attendance.refusal(
                1, "adsb", incarnation * INCARNATION + seq, t_ns, t_ns + 20 * MS
            )
            assert why == ""
            seq += 1


def test_fleet_check_knows_too_that_an_epoch_lists_nobody() -> None:
    """It is said to one that has been started again, while another is dead for good."""
    recorded_run = RecordedRunBuilder(apart(), Kill(node="1", start_s=1.0)).recorded_run(
        realtime=True
    )
    again = Record(CLOCK, encode(Clock(20, 2 * S, "epoch", {})), 20, 2 * S, 2 * S)
    later = [r for r in recorded_run.records if r.log_ns > 2 * S]
    records = [*list(recorded_run.records)[: -len(later)], again, *later]
    assert Index(replace(recorded_run, records=records), fates_of).absences.downs[1] == [(S, None)]
