"""Which commands are obeyed, and why the others are not."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.obedience import FINAL, MANOEUVRES, REASONS, refusal
from fleet.comms.messages import Cmd
from fleet.model.election import Mandate
from fleet.model.tracks import CommandId
from tests.samples import S, cmd

OWN = 2
NOW = 2 * S
MANDATE = Mandate(3, (1, 2), 1, 4 * S)
APPLIED = frozenset({CommandId(3, 1, 9)})
fast = settings(deadline=None, derandomize=True, max_examples=400)

TABLE: list[tuple[str, dict[str, Any], Mandate | None, int]] = [
    # reason, what differs from a good command, the mandate, now
    ("", {}, MANDATE, NOW),
    ("", {"manoeuvre": "climb"}, MANDATE, NOW),
    ("", {"manoeuvre": "turn_climb"}, MANDATE, NOW),
    ("", {"manoeuvre": "resume"}, MANDATE, NOW),
    ("", {}, MANDATE, 3 * S),  # the last moment at which the command is valid
    ("", {"expiry_ns": 9 * S}, MANDATE, 4 * S),  # and the last of the mandate
    ("wrong_target", {"target": 1}, MANDATE, NOW),
    ("wrong_target", {"target": 0}, MANDATE, NOW),
    ("no_mandate", {}, None, NOW),
    ("no_mandate", {"expiry_ns": 9 * S}, MANDATE, 4 * S + 1),
    ("stale_term", {"term": 2}, MANDATE, NOW),
    ("unknown_term", {"term": 4}, MANDATE, NOW),
    ("wrong_issuer", {"id": 2}, MANDATE, NOW),
    ("wrong_issuer", {"id": 0}, MANDATE, NOW),
    ("expired", {}, MANDATE, 3 * S + 1),
    ("duplicate", {"number": 9}, MANDATE, NOW),
    ("unknown_manoeuvre", {"manoeuvre": "loop"}, MANDATE, NOW),
    ("unknown_manoeuvre", {"manoeuvre": ""}, MANDATE, NOW),
]


@pytest.mark.parametrize(("reason", "changes", "mandate", "now_ns"), TABLE)
def test_a_command_is_refused_for_the_reason_that_applies(
    reason: str, changes: dict[str, Any], mandate: Mandate | None, now_ns: int
) -> None:
    assert refusal(cmd(**changes), OWN, mandate, APPLIED, now_ns) == reason


def test_every_reason_is_given_by_some_command() -> None:
    given_for = {refusal(cmd(**c), OWN, m, APPLIED, now_ns) for _, c, m, now_ns in TABLE}
    assert given_for - {""} == set(REASONS)


@pytest.mark.parametrize("field", ["term", "id", "number"])
def test_term_issuer_and_number_together_make_a_duplicate(field: str) -> None:
    command = cmd(id=1, term=3, number=9)
    assert refusal(command, OWN, MANDATE, APPLIED, NOW) == "duplicate"
    other = cmd(**{"id": 1, "term": 3, "number": 9, field: 8})
    assert refusal(other, OWN, MANDATE, APPLIED, NOW) != "duplicate"


times = st.integers(0, 4)
commands = st.builds(
    cmd,
    target=st.integers(1, 3),
    term=st.integers(2, 4),
    id=st.integers(0, 2),
    number=st.integers(1, 2),
    manoeuvre=st.sampled_from([*sorted(MANOEUVRES), "loop"]),
    expiry_ns=times,
)
mandates = st.builds(
    Mandate, st.integers(2, 4), st.just((1, 2)), st.integers(1, 2), valid_until_ns=times
)
applied_sets = st.sets(
    st.builds(CommandId, st.integers(2, 4), st.integers(0, 2), st.integers(1, 2)), max_size=3
)


@given(command=commands, mandate=st.none() | mandates, applied=applied_sets, now_ns=times)
@fast
def test_a_command_is_obeyed_only_if_all_conditions_hold(
    command: Cmd, mandate: Mandate | None, applied: set[CommandId], now_ns: int
) -> None:
    obeyed = not refusal(command, OWN, mandate, applied, now_ns)
    assert obeyed == (
        mandate is not None
        and mandate.term == command.term
        and mandate.computing == command.id
        and mandate.valid_until_ns >= now_ns
        and command.target == OWN
        and command.expiry_ns >= now_ns
        and command.manoeuvre in {"turn", "climb", "turn_climb", "resume"}
        and (command.term, command.id, command.number)
        not in {(c.term, c.issuer, c.number) for c in applied}
    )


@given(
    command=commands,
    mandate=mandates,
    applied=applied_sets,
    now_ns=times,
    wait_ns=times,
    terms=st.integers(0, 2),
    computing=st.integers(1, 2),
    extension_ns=times,
)
@fast
def test_a_final_refusal_is_never_mended_by_waiting(
    command: Cmd,
    mandate: Mandate,
    applied: set[CommandId],
    now_ns: int,
    wait_ns: int,
    terms: int,
    computing: int,
    extension_ns: int,
) -> None:
    later = Mandate(
        mandate.term + terms,
        mandate.members,
        computing if terms else mandate.computing,
        mandate.valid_until_ns + extension_ns,
    )
    if refusal(command, OWN, mandate, applied, now_ns) in FINAL:
        assert refusal(command, OWN, later, applied, now_ns + wait_ns)


def test_refusals_that_a_later_election_may_mend_are_not_final() -> None:
    assert set(REASONS) - FINAL == {"unknown_term", "no_mandate"}
    command = cmd(term=4)
    assert refusal(command, OWN, MANDATE, APPLIED, NOW) == "unknown_term"
    assert refusal(command, OWN, Mandate(4, (1, 2), 1, 4 * S), APPLIED, NOW) == ""
