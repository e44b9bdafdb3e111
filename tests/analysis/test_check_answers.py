"""Refusals have true reasons, and what is obeyed is flown: hand-written runs."""

from __future__ import annotations

import msgspec
import pytest

from fleet.analysis.invariants import Verdict
from fleet.model.units import to_ns
from fleet.protocol.messages import Command
from tests.analysis.test_check_story import RecordedRunBuilder, elect, make_command, obey
from tests.support import samples

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


def led() -> RecordedRunBuilder:
    """UAV 1 computes for 1 and 2 from 0.4 to 2.4 s, in term 4."""
    run_builder = RecordedRunBuilder()
    run_builder.fly(1, 2, 3, until_s=0.4)
    run_builder.tell(elect(4, (1, 2), 0.4, 2.4))
    return run_builder


def refuse(
    run_builder: RecordedRunBuilder, command: Command, reason: str, after_s: float = 0.1
) -> None:
    """UAV 2 answers so."""
    told = run_builder.tell(command)
    run_builder.tell(samples.ack(told, reason, t_ns=told.t_ns + to_ns(after_s)))


@pytest.mark.parametrize("reason", REASONS)
def test_a_reason_that_is_not_so(reason: str) -> None:
    run_builder = led()
    refuse(run_builder, make_command(2, 4, 1, 1.0), reason)
    assert run_builder.proof(REASON) == [
        f"UAV 2 refuses a command as '{reason}', which it is not",
        "0.400 s  coordinator/election  term=4 members=1,2 computing=1",
        "1.000 s  1/cmd/2  term=4 number=1 expiry_s=3.000",
        f"1.100 s  2/ack/1  term=4 number=1 reason={reason} own_clock_s=1.100",
    ]


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (make_command(2, 1, 1, 1.0), "stale_term"),
        (make_command(2, 8, 1, 1.0), "unknown_term"),
        (make_command(2, 4, 1, 2.4), "no_mandate"),
        (make_command(2, 4, 1, 1.0, expiry_ns=to_ns(1.05)), "expired"),
        (make_command(2, 4, 1, 1.0, id=3), "wrong_issuer"),
        (make_command(2, 4, 1, 1.0, manoeuvre="loop"), "unknown_manoeuvre"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_reason_that_is_so(command: Command, reason: str) -> None:
    run_builder = led()
    refuse(run_builder, command, reason)
    assert run_builder.check().of(REASON).verdict is Verdict.VALID


def test_only_the_last_command_has_a_duplicate_and_only_older_ones_are_superseded() -> None:
    run_builder = led()
    for number in (1, 2):
        run_builder.tell(obey(run_builder.tell(make_command(2, 4, number, 0.5 + number / 10))))
    refuse(run_builder, make_command(2, 4, 2, 1.0), "duplicate")
    refuse(run_builder, make_command(2, 4, 1, 1.1), "superseded")
    assert run_builder.check().of(REASON).verdict is Verdict.VALID
    refuse(run_builder, make_command(2, 4, 1, 1.3), "duplicate")
    refuse(run_builder, make_command(2, 4, 3, 1.4), "superseded")
    assert len(run_builder.check().of(REASON).witnesses) > 0


def flying(run_builder: RecordedRunBuilder, *numbers: int) -> None:
    """UAV 2 says every 0.1 s from 1.0 s on which command of term 4 it flies (0: none)."""
    for n, number in enumerate(numbers):
        identity = (4, 1, number) if number else (0, 0, 0)
        truth = samples.truth(2, (25.0, 40_000.0, -300.0), t_ns=to_ns(1.0 + n / 10))
        names = ("command_term", "command_issuer", "command_number")
        run_builder.say(msgspec.structs.replace(truth, **dict(zip(names, identity, strict=True))))


def told(
    run_builder: RecordedRunBuilder, number: int, at_s: float, start_s: float, end_s: float
) -> None:
    """UAV 2 obeys a command that starts and lapses then."""
    times = {"start_ns": to_ns(start_s), "manoeuvre_end_ns": to_ns(end_s)}
    command = run_builder.tell(make_command(2, 4, number, at_s, **times))
    run_builder.tell(msgspec.structs.replace(obey(command), actuate_ns=to_ns(start_s)))


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
def test_a_manoeuvre_is_flown_from_its_start_until_it_lapses(
    numbers: tuple[int, ...], valid: bool
) -> None:
    run_builder = led()
    told(run_builder, 1, 0.9, 1.2, 1.5)
    flying(run_builder, *numbers)
    assert (run_builder.check().of(FLOWN).verdict is Verdict.VALID) == valid


def test_a_later_command_replaces_one_that_waits_and_ends_one_in_force() -> None:
    run_builder = led()
    told(run_builder, 1, 0.8, 1.1, 2.0)
    told(run_builder, 2, 1.0, 1.5, 2.0)
    told(run_builder, 3, 1.1, 1.3, 2.0)
    flying(run_builder, 0, 1, 1, 3, 3, 3)
    assert run_builder.check().of(FLOWN).verdict is Verdict.VALID


def test_what_is_flown_instead_is_shown() -> None:
    run_builder = led()
    told(run_builder, 1, 0.9, 1.2, 1.5)
    flying(run_builder, 0, 0, 0)
    assert run_builder.proof(FLOWN, "positions as sensed") == [  # it does not broadcast any more
        "UAV 2 flies by its own plan, and should fly command 1 of UAV 1 in term 4",
        "1.000 s  2/ack/1  term=4 number=1 actuate_s=1.200",
        "1.200 s  2/truth  mode=plan command_number=0",
    ]
