"""What a UAV and the coordinator share: their clock, what is due, numbers, elections, memory."""

from __future__ import annotations

import pytest

from fleet.faults.kinds.clock import ClockError
from fleet.faults.registry import FaultRule
from fleet.model.election import Mandate
from fleet.model.types import COORDINATOR
from fleet.node.base import BaseNode
from fleet.node.node import RestartState
from fleet.protocol.messages import Ack, Command, Election, PersistentState
from tests.support.samples import MS, S, head_on

MEMORY = PersistentState(2, 7, S, 12, 8, 8, 3)


def node(*plan: FaultRule, number: int = 2, restart: RestartState | None = None) -> BaseNode:
    return BaseNode(number, head_on(fault=plan), restart, None)


def test_each_class_is_numbered_by_itself() -> None:
    one = node()
    assert [one._next(c) for c in (Ack, Ack, Command, Ack)] == [0, 1, 0, 2]


def test_who_has_been_started_again_numbers_above_all_that_it_sent_before() -> None:
    one = node(restart=RestartState(3, 5 * S))
    assert [one._next(Ack), one._next(Ack)] == [3 * 10**9, 3 * 10**9 + 1]


def test_what_is_periodic_is_due_once_a_period_whenever_the_steps_come() -> None:
    one, due = node(), []
    for now_ms in (0, 100, 350, 400, 950, 1000):
        due.append(one._due(now_ms * MS, 400 * MS))
        one._last_ns = now_ms * MS
    assert due == [True, False, False, True, True, False]


def test_after_a_restart_nothing_is_due_twice() -> None:
    one = node(restart=RestartState(1, 900 * MS))
    assert not one._due(1000 * MS, 400 * MS)
    assert one._due(1200 * MS, 400 * MS)


def test_a_node_goes_by_its_own_clock_which_never_shows_less_than_nothing() -> None:
    ahead, behind = (ClockError(node="2", offset_s=s) for s in (0.5, -0.5))
    assert node(ahead)._local(S) == 1500 * MS
    assert node(ahead, number=1)._local(S) == S
    assert node(behind)._local(200 * MS) == 0
    changed = node(ahead)
    changed.replan([behind])
    assert changed._local(S) == 500 * MS


@pytest.mark.parametrize("number", [COORDINATOR, 2])
def test_an_election_announces_a_mandate(number: int) -> None:
    mandate = Mandate(5, (2, 3), 3, 4 * S)
    announced = node(number=number)._election(mandate, 2 * S)
    assert announced == Election(number, 0, 2 * S, 5, 2, (2, 3), 3, 4 * S)


def test_what_must_outlive_the_process_is_sent_when_it_changes() -> None:
    one = node()
    assert one._remember(0, 0, 0, (0, 0)) == []
    assert one._remember(S, 4, 4, (0, 0)) == [PersistentState(2, 0, S, 4, 4, 0, 0)]
    assert one._remember(2 * S, 4, 4, (0, 0)) == []
    assert one._remember(3 * S, 4, 4, (4, 1)) == [PersistentState(2, 1, 3 * S, 4, 4, 4, 1)]


def test_what_a_restarted_process_remembers_is_not_sent_again() -> None:
    one = node(restart=RestartState(1, 5 * S, MEMORY))
    assert one._remember(6 * S, 12, 8, (8, 3)) == []
    assert one._remember(7 * S, 13, 8, (8, 3)) == [PersistentState(2, 10**9, 7 * S, 13, 8, 8, 3)]
