"""Refusals have true reasons, and what is obeyed is flown: hand-written histories."""

from __future__ import annotations

import msgspec
import pytest

from fleet.analysis.invariants import Verdict
from fleet.comms.messages import Cmd
from fleet.model.units import to_ns
from tests import samples
from tests.test_check_story import Story, command, elect, obey

REASON, FLOWN = "refused for a reason", "flown as obeyed"
REASONS = (
    "wrong_target",
    "no_mandate",
    "stale_term",
    "unknown_term",
    "wrong_issuer",
    "expired",
    "duplicate",
    "superseded",
    "unknown_manoeuvre",
    "mood",
)


def led() -> Story:
    """UAV 1 computes for 1 and 2 from 0.4 to 2.4 s, in term 4."""
    story = Story()
    story.fly(1, 2, 3, until_s=0.4)
    story.tell(elect(4, (1, 2), 0.4, 2.4))
    return story


def refuse(story: Story, cmd: Cmd, reason: str, after_s: float = 0.1) -> None:
    """UAV 2 answers so."""
    told = story.tell(cmd)
    story.tell(samples.ack(told, reason, t_ns=told.t_ns + to_ns(after_s)))


@pytest.mark.parametrize("reason", REASONS)
def test_a_reason_that_is_not_so(reason: str) -> None:
    story = led()
    refuse(story, command(2, 4, 1, 1.0), reason)
    assert story.proof(REASON) == [
        f"UAV 2 refuses a command as '{reason}', which it is not",
        "0.400 s  coordinator/election  term=4 members=1,2 computing=1",
        "1.000 s  1/cmd/2  term=4 number=1 expiry_s=3.000",
        f"1.100 s  2/ack/1  term=4 number=1 reason={reason} own_clock_s=1.100",
    ]


@pytest.mark.parametrize(
    ("cmd", "reason"),
    [
        (command(2, 1, 1, 1.0), "stale_term"),
        (command(2, 8, 1, 1.0), "unknown_term"),
        (command(2, 4, 1, 2.4), "no_mandate"),
        (command(2, 4, 1, 1.0, expiry_ns=to_ns(1.05)), "expired"),
        (command(2, 4, 1, 1.0, id=3), "wrong_issuer"),
        (command(2, 4, 1, 1.0, manoeuvre="loop"), "unknown_manoeuvre"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_reason_that_is_so(cmd: Cmd, reason: str) -> None:
    story = led()
    refuse(story, cmd, reason)
    assert story.check().of(REASON).verdict is Verdict.VALID


def test_only_the_last_command_has_a_duplicate_and_only_older_ones_are_superseded() -> None:
    story = led()
    for number in (1, 2):
        story.tell(obey(story.tell(command(2, 4, number, 0.5 + number / 10))))
    refuse(story, command(2, 4, 2, 1.0), "duplicate")
    refuse(story, command(2, 4, 1, 1.1), "superseded")
    assert story.check().of(REASON).verdict is Verdict.VALID
    refuse(story, command(2, 4, 1, 1.3), "duplicate")
    refuse(story, command(2, 4, 3, 1.4), "superseded")
    assert len(story.check().of(REASON).witnesses) > 0


def flying(story: Story, *numbers: int) -> None:
    """UAV 2 says every 0.1 s from 1.0 s on which command of term 4 it flies (0: none)."""
    for n, number in enumerate(numbers):
        identity = (4, 1, number) if number else (0, 0, 0)
        truth = samples.truth(2, (25.0, 40_000.0, -300.0), t_ns=to_ns(1.0 + n / 10))
        names = ("command_term", "command_issuer", "command_number")
        story.say(msgspec.structs.replace(truth, **dict(zip(names, identity, strict=True))))


def told(story: Story, number: int, at_s: float, start_s: float, end_s: float) -> None:
    """UAV 2 obeys a command that starts and lapses then."""
    times = {"start_ns": to_ns(start_s), "escape_end_ns": to_ns(end_s)}
    cmd = story.tell(command(2, 4, number, at_s, **times))
    story.tell(msgspec.structs.replace(obey(cmd), actuate_ns=to_ns(start_s)))


@pytest.mark.parametrize(
    ("numbers", "valid"),
    [
        ((0, 0, 1, 1, 1, 0, 0), True),
        ((0, 0, 0, 1, 1, 0, 0), False),
        ((0, 1, 1, 1, 1, 0, 0), False),
        ((0, 0, 1, 1, 1, 1, 0), False),
        ((0, 0, 1, 1, 0, 0, 0), False),
        ((0, 0, 2, 2, 2, 0, 0), False),
    ],
)
def test_an_escape_is_flown_from_its_start_until_it_lapses(
    numbers: tuple[int, ...], valid: bool
) -> None:
    story = led()
    told(story, 1, 0.9, 1.2, 1.5)
    flying(story, *numbers)
    assert (story.check().of(FLOWN).verdict is Verdict.VALID) == valid


def test_a_later_command_replaces_one_that_waits_and_ends_one_in_force() -> None:
    story = led()
    told(story, 1, 0.8, 1.1, 2.0)
    told(story, 2, 1.0, 1.5, 2.0)
    told(story, 3, 1.1, 1.3, 2.0)
    flying(story, 0, 1, 1, 3, 3, 3)
    assert story.check().of(FLOWN).verdict is Verdict.VALID


def test_what_is_flown_instead_is_shown() -> None:
    story = led()
    told(story, 1, 0.9, 1.2, 1.5)
    flying(story, 0, 0, 0)
    assert story.proof(FLOWN, "positions as sensed") == [  # it does not broadcast any more
        "UAV 2 flies by its own plan, and should fly command 1 of UAV 1 in term 4",
        "1.000 s  2/ack/1  term=4 number=1 actuate_s=1.200",
        "1.200 s  2/truth  mode=plan command_number=0",
    ]
