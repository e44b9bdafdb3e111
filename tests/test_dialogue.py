"""What a computing UAV knows of the commands that it has sent."""

from __future__ import annotations

from agents.dialogue import Dialogue
from fleet.comms.messages import Cmd
from fleet.model.tracks import NO_COMMAND, CommandId
from tests.samples import MS, S, ack, cmd

AGAIN_NS = 600 * MS


def sent(number: int, issued_ns: int) -> Cmd:
    return cmd(number=number, issued_ns=issued_ns, expiry_ns=issued_ns + 2 * S)


def flown(command: Cmd) -> CommandId:
    return CommandId(command.term, command.id, command.number)


def dialogue(*commands: Cmd) -> Dialogue:
    made = Dialogue(AGAIN_NS)
    for command in commands:
        made.send(command)
    return made


FIRST, SECOND = sent(1, 5 * S), sent(2, 6 * S)


def test_a_command_on_its_way_is_the_last_and_is_repeated_until_it_expires() -> None:
    made = dialogue(FIRST)
    repeated = [t for t in range(5 * S, 9 * S, 200 * MS) if made.repetition(t)]
    assert repeated == [5 * S + n * AGAIN_NS for n in (1, 2, 3)]


def test_one_that_expired_unanswered_leaves_the_one_before_in_force() -> None:
    made = dialogue(FIRST)
    made.on_ack(ack(FIRST))
    made.send(SECOND)
    assert made.last == SECOND
    made.repetition(SECOND.expiry_ns + 1)
    assert (made.last, made.waits) == (FIRST, False)


def test_an_answer_counts_though_it_comes_after_the_expiry() -> None:
    made = dialogue(FIRST)
    made.repetition(FIRST.expiry_ns + 1)
    assert made.last is None
    made.on_ack(ack(FIRST))
    assert made.last == FIRST


def test_a_broadcast_that_tells_the_command_is_an_answer() -> None:
    made = dialogue(FIRST)
    made.on_flown(flown(FIRST))
    assert (made.last, made.repetition(6 * S)) == (FIRST, None)


def test_an_answer_to_an_earlier_command_does_not_stop_the_later_one() -> None:
    made = dialogue(FIRST, SECOND)
    made.on_ack(ack(FIRST))
    assert made.last == SECOND
    assert made.repetition(6 * S + AGAIN_NS) == SECOND
    made.repetition(SECOND.expiry_ns + 1)
    assert made.last == FIRST


def test_what_arrived_late_does_not_come_before_what_arrived() -> None:
    made = dialogue(FIRST, SECOND)
    made.on_flown(flown(SECOND))
    made.on_ack(ack(FIRST))
    assert made.last == SECOND


def test_a_refusal_for_good_takes_the_command_back() -> None:
    made = dialogue(FIRST)
    made.on_ack(ack(FIRST))
    made.send(SECOND)
    made.on_ack(ack(SECOND, accepted=False, reason="stale_term"))
    assert (made.last, made.waits) == (FIRST, False)


def test_a_refusal_that_a_repetition_may_mend_changes_nothing() -> None:
    made = dialogue(FIRST)
    made.on_ack(ack(FIRST, accepted=False, reason="no_mandate"))
    assert (made.last, made.waits) == (FIRST, True)


def test_answers_about_other_commands_change_nothing() -> None:
    made = dialogue(FIRST)
    made.on_ack(ack(SECOND))
    made.on_flown(NO_COMMAND)
    assert (made.last, made.waits) == (FIRST, True)
