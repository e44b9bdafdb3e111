"""Outages of a realtime run: who was not heard, from when to when, and how it ended."""

from __future__ import annotations

import msgspec
import pytest

from fleet.model.conflict.contact import INCARNATION
from fleet.model.types import COORDINATOR
from fleet.model.words import OutageEnd
from fleet.node.join_info import join_info_of, plan_bytes
from fleet.node.node import RestartState
from fleet.protocol.attendance import OUT_OF_ORDER, RESUME_NS, Attendance
from fleet.protocol.messages import Outage
from fleet.simulation.outages import OutageTracker
from fleet.simulation.watchdog import lost_words
from tests.support.samples import MS, S, head_on

TICK_NS = 100 * MS


@pytest.fixture
def tracker() -> OutageTracker:
    return OutageTracker(head_on())


def test_who_is_heard_again_was_silent_since_it_was_last_heard(tracker: OutageTracker) -> None:
    for at_ns in range(0, S, TICK_NS):
        assert tracker.heard(1, at_ns) is None
    assert tracker.silent(S + 200 * MS) == [2, 3]
    assert tracker.silent(2 * S) == [COORDINATOR, 1, 2, 3]
    assert tracker.heard(1, 4 * S) == Outage(4 * S, 1, 900 * MS, OutageEnd.BACK)
    assert tracker.heard(1, 4 * S + TICK_NS) is None


def test_the_coordinator_is_heard_less_often(tracker: OutageTracker) -> None:
    assert tracker.heard(COORDINATOR, 1500 * MS) is None
    assert tracker.heard(COORDINATOR, 3200 * MS) is not None


def test_who_is_stopped_by_the_fault_plan_is_not_silent(tracker: OutageTracker) -> None:
    for tick in range(50):
        tracker.excuse([2], tick * TICK_NS)
    assert 2 not in tracker.silent(5 * S)
    assert tracker.heard(2, 5 * S) is None


def test_who_is_not_back_by_the_end_is_lost(tracker: OutageTracker) -> None:
    for node in (COORDINATOR, 1, 3):
        tracker.heard(node, 10 * S)
    assert tracker.finish(10 * S) == [Outage(10 * S, 2, 0, OutageEnd.LOST)]


def test_one_that_left_and_is_heard_again_has_not_left(tracker: OutageTracker) -> None:
    """Its token is back before its messages; what was still on its way does not count."""
    tracker.leave(1)
    tracker.heard(1, 100 * MS)
    assert tracker.absent(200 * MS) == {1}
    tracker.come(1)
    tracker.heard(1, 300 * MS)
    assert tracker.absent(400 * MS) == set()


def test_another_process_in_its_place_ends_the_outage(tracker: OutageTracker) -> None:
    tracker.heard(1, S)
    tracker.leave(1)
    tracker.come(1)
    assert tracker.restarted(1, 3 * S) == Outage(3 * S, 1, S, OutageEnd.RESTARTED)
    assert tracker.absent(3 * S) == {COORDINATOR, 2, 3}


def sequence(attendance: Attendance, *numbers: int, at_ns: int) -> list[str]:
    """What is wrong with broadcasts of UAV 1 with these numbers, which come at a time."""
    return [attendance.refusal(1, "adsb", n, at_ns, at_ns) for n in numbers]


def test_after_an_outage_numbers_may_be_missing_and_at_no_other_time() -> None:
    attendance = Attendance(TICK_NS)
    assert sequence(attendance, 0, 1, at_ns=S) == ["", ""]
    attendance.outage(Outage(5 * S, 1, S, OutageEnd.BACK))
    assert sequence(attendance, 2, 7, 8, at_ns=5 * S) == ["", "", ""]
    assert attendance.missing == {1: 4}
    assert sequence(attendance, 8, at_ns=5 * S) == [OUT_OF_ORDER]
    later_ns = 5 * S + RESUME_NS + 1
    assert sequence(attendance, 9, 11, at_ns=later_ns) == ["", OUT_OF_ORDER]


def test_the_first_of_a_class_after_an_outage_may_be_late_and_have_a_gap_before_it() -> None:
    attendance = Attendance(TICK_NS)
    attendance.outage(Outage(5 * S, 1, S, OutageEnd.BACK))
    assert sequence(attendance, 3, at_ns=60 * S) == [""]
    assert attendance.missing == {1: 3}


def test_a_process_that_came_in_the_place_of_another_numbers_in_the_next_incarnation() -> None:
    attendance = Attendance(TICK_NS)
    assert sequence(attendance, 0, at_ns=S) == [""]
    assert sequence(attendance, INCARNATION, at_ns=3 * S) == [OUT_OF_ORDER]
    attendance.outage(Outage(3 * S, 1, S, OutageEnd.RESTARTED))
    assert sequence(attendance, INCARNATION, INCARNATION + 1, at_ns=3 * S) == ["", ""]
    assert attendance.was_cut(1, 0)
    assert not attendance.was_cut(1, 1)


def test_who_comes_in_anothers_place_is_told_what_it_finds() -> None:
    found = RestartState(1, 3 * S)
    plan = plan_bytes("realtime", head_on(), 7.0, {"2": found})
    assert join_info_of("", "", plan, name="2").restart == found
    assert join_info_of("", "", plan, name="1").restart is None
    assert join_info_of("", "", plan, name="1").lease_s == 7.0


@pytest.mark.parametrize("lease_s", [0, -1, 1e9])
def test_a_plan_with_an_absurd_lease_is_not_understood(lease_s: float) -> None:
    plan = msgspec.json.decode(plan_bytes("realtime", head_on()))
    with pytest.raises(ValueError, match="lease_s"):
        join_info_of("", "", msgspec.json.encode({**plan, "lease_s": lease_s}))


@pytest.mark.parametrize(
    ("gone", "silent", "says"),
    [
        ({"3"}, {"3"}, "process 3 stopped answering: ended, or cut off from the router"),
        (
            {"10"},
            {"9", "10", "coordinator"},
            "processes coordinator, 9, 10 stopped answering: 10 ended, or cut off from the router; "
            "the rest is silent",
        ),
    ],
)
def test_all_who_are_lost_are_named(gone: set[str], silent: set[str], says: str) -> None:
    assert lost_words(gone, silent) == says
