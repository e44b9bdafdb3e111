"""What a computing UAV knows of the commands that it has sent."""

from __future__ import annotations

import pytest

from fleet.agents.command_exchange import CommandExchange
from fleet.model.conflict.tracks import NO_COMMAND, CommandId
from fleet.protocol.messages import Command
from tests.support.samples import MS, S, ack, command

AGAIN_NS = 600 * MS


def sent(number: int, issued_ns: int) -> Command:
    return command(number=number, issued_ns=issued_ns, expiry_ns=issued_ns + 2 * S)


def flown(sent: Command) -> CommandId:
    return CommandId(sent.term, sent.id, sent.number)


def exchange(*commands: Command) -> CommandExchange:
    made = CommandExchange(AGAIN_NS)
    for one in commands:
        made.send(one)
    return made


FIRST, SECOND = sent(1, 5 * S), sent(2, 6 * S)


def test_nothing_is_overdue_before_the_limit_or_after_an_answer() -> None:
    made = exchange(FIRST)
    assert not made.overdue(4 * S, 1.0, 9 * S)
    assert made.overdue(4 * S, 1.0, 9 * S + 1)
    made.on_ack(ack(FIRST))
    assert not made.overdue(4 * S, 1.0, 99 * S)
    assert not CommandExchange(AGAIN_NS).overdue(0, 1.0, 99 * S)


def test_what_is_overdue_counts_from_the_first_that_was_not_answered() -> None:
    made = exchange(FIRST, SECOND)
    assert made.overdue(4 * S, 1.0, 9 * S + 1)
    made.on_flown(flown(SECOND))
    made.send(sent(3, 12 * S))
    assert not made.overdue(4 * S, 1.0, 16 * S)
    assert made.overdue(4 * S, 1.0, 16 * S + 1)


def test_a_late_answer_to_a_command_given_up_shows_that_it_is_heard() -> None:
    made = exchange(FIRST)
    made.repetition(FIRST.expiry_ns + 1)
    made.send(sent(3, 10 * S))
    made.on_ack(ack(FIRST))
    assert not made.overdue(4 * S, 1.0, 99 * S)


@pytest.mark.parametrize(
    ("share", "attempts"),
    [
        (1.0, 1),
        (0.9, 5),  # of 0.81 there and back: 0.19^4 = 0.0013, 0.19^5 = 0.0002
        (0.7, 11),  # 0.51^10 = 0.0012, 0.51^11 = 0.0006
        (0.5, 25),  # 0.75^24 = 0.0010034, 0.75^25 = 0.00075
    ],
)
def test_on_a_lossy_link_it_takes_more_attempts(share: float, attempts: int) -> None:
    made = CommandExchange(AGAIN_NS)
    overdue = []
    for n in range(attempts):
        made.send(sent(n + 1, (5 + n) * S))
        overdue.append(made.overdue(0, share, 99 * S))
    assert overdue == [False] * (attempts - 1) + [True]


def test_a_command_on_its_way_is_the_last_and_is_repeated_until_it_expires() -> None:
    made = exchange(FIRST)
    repeated = [t for t in range(5 * S, 9 * S, 200 * MS) if made.repetition(t)]
    assert repeated == [5 * S + n * AGAIN_NS for n in (1, 2, 3)]


def test_one_that_expired_unanswered_leaves_the_one_before_in_force() -> None:
    made = exchange(FIRST)
    made.on_ack(ack(FIRST))
    made.send(SECOND)
    assert made.last == SECOND
    made.repetition(SECOND.expiry_ns + 1)
    assert (made.last, made.waits) == (FIRST, False)


def test_an_answer_counts_though_it_comes_after_the_expiry() -> None:
    made = exchange(FIRST)
    made.repetition(FIRST.expiry_ns + 1)
    assert made.last is None
    made.on_ack(ack(FIRST))
    assert made.last == FIRST


def test_a_broadcast_that_tells_the_command_is_an_answer() -> None:
    made = exchange(FIRST)
    made.on_flown(flown(FIRST))
    assert (made.last, made.repetition(6 * S)) == (FIRST, None)


def test_an_answer_to_an_earlier_command_does_not_stop_the_later_one() -> None:
    made = exchange(FIRST, SECOND)
    made.on_ack(ack(FIRST))
    assert made.last == SECOND
    assert made.repetition(6 * S + AGAIN_NS) == SECOND
    made.repetition(SECOND.expiry_ns + 1)
    assert made.last == FIRST


def test_what_arrived_late_does_not_come_before_what_arrived() -> None:
    made = exchange(FIRST, SECOND)
    made.on_flown(flown(SECOND))
    made.on_ack(ack(FIRST))
    assert made.last == SECOND


def test_a_refusal_for_good_takes_the_command_back() -> None:
    made = exchange(FIRST)
    made.on_ack(ack(FIRST))
    made.send(SECOND)
    made.on_ack(ack(SECOND, accepted=False, reason="stale_term"))
    assert (made.last, made.waits) == (FIRST, False)


def test_a_refusal_that_a_repetition_may_mend_changes_nothing() -> None:
    made = exchange(FIRST)
    made.on_ack(ack(FIRST, accepted=False, reason="no_mandate"))
    assert (made.last, made.waits) == (FIRST, True)


def test_answers_about_other_commands_change_nothing() -> None:
    made = exchange(FIRST)
    made.on_ack(ack(SECOND))
    made.on_flown(NO_COMMAND)
    assert (made.last, made.waits) == (FIRST, True)
