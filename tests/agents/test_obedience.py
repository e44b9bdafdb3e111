"""Which commands are obeyed, and why the others are not."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.agents.obedience import (
    FINAL,
    FLYABLE_MANOEUVRES,
    REFUSAL_REASONS,
    Applied,
    Recipient,
    refusal,
)
from fleet.model.election import Mandate
from fleet.protocol.messages import Command
from tests.support.samples import S, command

OWN = 2
NOW = 2 * S
MANDATE = Mandate(3, (1, 2), 1, 4 * S)
APPLIED: Applied = (3, 7)
"""The last command applied, unless it is said otherwise."""
SPEEDS_MPS = (20.0, 30.0)
"""What the UAV may fly."""
fast = settings(deadline=None, derandomize=True, max_examples=400)


def good(**changes: Any) -> Command:
    """A command that is obeyed, but for what is changed in it."""
    return command(**{"number": 8, **changes})


TABLE: list[tuple[str, dict[str, Any], Mandate | None, int, int]] = [
    # reason, what differs from a good command, the mandate, now, the minimum accepted term
    ("", {}, MANDATE, NOW, 0),
    ("", {"manoeuvre": "climb"}, MANDATE, NOW, 0),
    ("", {"manoeuvre": "turn_climb"}, MANDATE, NOW, 0),
    ("", {"manoeuvre": "resume"}, MANDATE, NOW, 0),
    ("", {"manoeuvre": "speed", "speed_mps": 20.0}, MANDATE, NOW, 0),
    ("", {"manoeuvre": "speed", "speed_mps": 30.0}, MANDATE, NOW, 0),
    ("", {"manoeuvre": "turn", "speed_mps": 99.0}, MANDATE, NOW, 0),  # no turn has a speed
    ("", {"number": 99}, MANDATE, NOW, 0),
    ("", {"term": 4, "number": 1}, Mandate(4, (1, 2), 1, 4 * S), NOW, 0),  # a term counts anew
    ("", {}, MANDATE, NOW, 3),
    ("", {}, MANDATE, 3 * S, 0),  # the last moment at which the command is valid
    ("", {"expiry_ns": 9 * S}, MANDATE, 4 * S, 0),  # and the last of the mandate
    ("wrong_target", {"target": 1}, MANDATE, NOW, 0),
    ("wrong_target", {"target": 0}, MANDATE, NOW, 0),
    ("wrong_target", {"target": 1, "number": 7}, MANDATE, NOW, 0),
    ("no_mandate", {}, None, NOW, 0),
    ("no_mandate", {}, None, NOW, 3),
    ("no_mandate", {"expiry_ns": 9 * S}, MANDATE, 4 * S + 1, 0),
    ("stale_term", {"term": 2}, MANDATE, NOW, 0),
    ("stale_term", {}, None, NOW, 4),  # the mandate of an earlier incarnation
    ("stale_term", {}, MANDATE, NOW, 4),
    ("unknown_term", {"term": 4}, MANDATE, NOW, 0),
    ("wrong_issuer", {"id": 2}, MANDATE, NOW, 0),
    ("wrong_issuer", {"id": 0}, MANDATE, NOW, 0),
    ("expired", {}, MANDATE, 3 * S + 1, 0),
    ("duplicate", {"number": 7}, MANDATE, NOW, 0),
    ("duplicate", {"number": 7}, None, 9 * S, 9),  # whatever has become of the mandate
    ("superseded", {"number": 6}, MANDATE, NOW, 0),
    ("superseded", {"number": 1}, MANDATE, NOW, 3),
    ("unknown_manoeuvre", {"manoeuvre": "loop"}, MANDATE, NOW, 0),
    ("unknown_manoeuvre", {"manoeuvre": ""}, MANDATE, NOW, 0),
    ("beyond_limits", {"manoeuvre": "speed"}, MANDATE, NOW, 0),
    ("beyond_limits", {"manoeuvre": "speed", "speed_mps": 19.9}, MANDATE, NOW, 0),
    ("beyond_limits", {"manoeuvre": "speed", "speed_mps": 30.1}, MANDATE, NOW, 0),
]


@pytest.mark.parametrize(("reason", "changes", "mandate", "now_ns", "minimum_term"), TABLE)
def test_a_command_is_refused_for_the_reason_that_applies(
    reason: str, changes: dict[str, Any], mandate: Mandate | None, now_ns: int, minimum_term: int
) -> None:
    uav = Recipient(OWN, mandate, APPLIED, minimum_term, SPEEDS_MPS)
    assert refusal(good(**changes), uav, now_ns) == reason


def test_every_reason_is_given_by_some_command() -> None:
    given_for = {
        refusal(good(**changes), Recipient(OWN, mandate, APPLIED, minimum, SPEEDS_MPS), now_ns)
        for _, changes, mandate, now_ns, minimum in TABLE
    }
    assert given_for - {""} == set(REFUSAL_REASONS)


@pytest.mark.parametrize("field", ["term", "number"])
def test_term_and_number_together_make_a_duplicate(field: str) -> None:
    """A term has one computing UAV, which numbers its commands: they need no issuer."""
    assert refusal(command(term=3, number=7), Recipient(OWN, MANDATE, APPLIED), NOW) == "duplicate"
    other = command(**{"term": 3, "number": 7, field: 2})
    assert refusal(other, Recipient(OWN, MANDATE, APPLIED), NOW) not in ("", "duplicate")


times = st.integers(0, 4)
commands = st.builds(
    command,
    target=st.integers(1, 3),
    term=st.integers(2, 4),
    id=st.integers(0, 2),
    number=st.integers(1, 2),
    manoeuvre=st.sampled_from([*sorted(FLYABLE_MANOEUVRES), "loop"]),
    expiry_ns=times,
    speed_mps=st.none() | st.floats(15.0, 35.0),
)
mandates = st.builds(
    Mandate, st.integers(2, 4), st.just((1, 2)), st.integers(1, 2), valid_until_ns=times
)
applied_before = st.tuples(st.integers(0, 4), st.integers(0, 2))
minimum_terms = st.integers(0, 5)


@given(
    command=commands,
    mandate=st.none() | mandates,
    applied=applied_before,
    now_ns=times,
    minimum_term=minimum_terms,
)
@fast
def test_a_command_is_obeyed_only_if_all_conditions_hold(
    command: Command, mandate: Mandate | None, applied: Applied, now_ns: int, minimum_term: int
) -> None:
    uav = Recipient(OWN, mandate, applied, minimum_term, SPEEDS_MPS)
    obeyed = not refusal(command, uav, now_ns)
    slow = command.speed_mps is None or command.speed_mps < 20.0
    fast = command.speed_mps is not None and command.speed_mps > 30.0
    assert obeyed == (
        mandate is not None
        and mandate.term == command.term
        and mandate.computing == command.id
        and mandate.valid_until_ns >= now_ns
        and command.target == OWN
        and command.expiry_ns >= now_ns
        and command.manoeuvre in {"turn", "climb", "turn_climb", "speed", "resume"}
        and not (command.manoeuvre == "speed" and (slow or fast))
        and (command.term, command.number) > applied
        and command.term >= minimum_term
    )


@given(commands, mandates, applied_before, times)
@fast
def test_what_has_been_applied_is_never_obeyed_again(
    command: Command, mandate: Mandate, applied: Applied, now_ns: int
) -> None:
    """Also not after others have been: the last one tells of all before it."""
    if refusal(command, Recipient(OWN, mandate, applied), now_ns):
        return
    own = (command.term, command.number)
    for later in (own, (command.term, command.number + 1), (command.term + 1, 0)):
        assert refusal(command, Recipient(OWN, mandate, later), now_ns)


@given(
    command=commands,
    mandate=mandates,
    applied=applied_before,
    now_ns=times,
    wait_ns=times,
    terms=st.integers(0, 2),
    computing=st.integers(1, 2),
    extension_ns=times,
    minimum_term=minimum_terms,
)
@fast
def test_a_final_refusal_is_never_mended_by_waiting(
    command: Command,
    mandate: Mandate,
    applied: Applied,
    now_ns: int,
    wait_ns: int,
    terms: int,
    computing: int,
    extension_ns: int,
    minimum_term: int,
) -> None:
    later = Mandate(
        mandate.term + terms,
        mandate.members,
        computing if terms else mandate.computing,
        mandate.valid_until_ns + extension_ns,
    )
    if refusal(command, Recipient(OWN, mandate, applied, minimum_term), now_ns) in FINAL:
        after = Recipient(OWN, later, applied, max(minimum_term, later.term))
        assert refusal(command, after, now_ns + wait_ns)


def test_refusals_that_a_later_election_may_mend_are_not_final() -> None:
    assert set(REFUSAL_REASONS) - FINAL == {"unknown_term", "no_mandate"}
    told = command(term=4)
    assert refusal(told, Recipient(OWN, MANDATE, APPLIED), NOW) == "unknown_term"
    assert refusal(told, Recipient(OWN, None, APPLIED), NOW) == "no_mandate"
    assert refusal(told, Recipient(OWN, Mandate(4, (1, 2), 1, 4 * S), APPLIED), NOW) == ""
