"""Rules of what a UAV concludes from elections, heartbeats and silence."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from fleet.conformance import script
from fleet.conformance.evidence import Evidence
from fleet.conformance.rule import LOCKSTEP, NotTriedError, protocol_rule
from fleet.protocol.messages import PersistentState, StateBroadcast
from fleet.protocol.topics import issuer_name

_ELECTIONS = "elections-and-commands.md#elections"
_MANDATE = (8, 4)
"""When an election names it first, and its term."""


@protocol_rule("keeps the election that names it", _ELECTIONS, LOCKSTEP)
def _keeps(e: Evidence) -> Iterator[str]:
    """As `mandate_term` and `mandate_valid` say."""
    before, after = _told(e, _MANDATE[0] - 2), _told(e, _MANDATE[0] + 2)
    if (before.mandate_term, before.mandate_valid) != (0, False):
        yield f"before any election it tells of a mandate of term {before.mandate_term}"
    yield from _mandate(after, _MANDATE[1], valid=True)


@protocol_rule("keeps the election of the highest term, of whichever elector", _ELECTIONS, LOCKSTEP)
def _highest(e: Evidence) -> Iterator[str]:
    """The coordinator's of term 8, and then that of UAV 1 of term 9."""
    yield from _mandate(_told(e, script.AFTER_LOCAL.tick + 2), 9, valid=True)


@protocol_rule("ignores elections of a lower term", _ELECTIONS, LOCKSTEP)
def _lower(e: Evidence) -> Iterator[str]:
    """Term 4 after term 9."""
    yield from _mandate(_told(e, script.LOWER + 2), 9, valid=True)


@protocol_rule("ignores elections in a term that is not their issuer's", _ELECTIONS, LOCKSTEP)
def _not_its_own(e: Evidence) -> Iterator[str]:
    """Term 13 is UAV 1's, not the coordinator's."""
    yield from _ignored(_told(e, script.NOT_ITS_OWN + 1), 13)


@protocol_rule("ignores a UAV that elects another UAV", _ELECTIONS, LOCKSTEP)
def _of_another(e: Evidence) -> Iterator[str]:
    """UAV 3 elects UAV 1 in term 15, which is its own."""
    told = _told(e, script.OF_ANOTHER + 2)
    if told.highest_term < 13:  # else it has learnt that already from what it should have ignored
        yield from _ignored(told, 15)
    if told.mandate_term == 15:
        yield "it keeps it as its mandate"


@protocol_rule("tells the highest term of all elections, of any group", _ELECTIONS, LOCKSTEP)
def _other_group(e: Evidence) -> Iterator[str]:
    """Term 12 of a group that it is not in."""
    told = _told(e, script.OTHER_GROUP + 1)
    if told.highest_term < 12:
        yield f"highest_term is {told.highest_term} after an election of term 12"
    if told.mandate_term == 12:
        yield "it keeps an election as its mandate that does not name it"


@protocol_rule("learns terms from heartbeats", _ELECTIONS, LOCKSTEP)
def _heartbeats(e: Evidence) -> Iterator[str]:
    """16 by the coordinator."""
    told = _told(e, script.LEARNED + 2)
    if told.highest_term < 16:
        yield f"highest_term is {told.highest_term} after a heartbeat that tells 16"


@protocol_rule("lets a mandate end at its time", _ELECTIONS, LOCKSTEP)
def _runs_out(e: Evidence) -> Iterator[str]:
    """`mandate_term` stays, `mandate_valid` does not."""
    yield from _mandate(_told(e, script.RUN_OUT), 9, valid=False)


@protocol_rule(
    "lets a mandate last no longer than `election_valid_s` after it heard it", _ELECTIONS, LOCKSTEP
)
def _too_long(e: Evidence) -> Iterator[str]:
    """The elector's clock may be ahead."""
    yield from _mandate(_told(e, script.TOO_LONG - 5), 16, valid=True)
    yield from _mandate(_told(e, script.TOO_LONG), 16, valid=False)


@protocol_rule("says whether it hears others", "wire-format.md#statebroadcast", LOCKSTEP)
def _hears(e: Evidence) -> Iterator[str]:
    """Not when nobody has broadcast for longer than the limit of silence."""
    if not _told(e, script.SILENT[0] - 2).hears:
        yield "hears is false while two UAVs broadcast"
    if _told(e, script.SILENT[-1]).hears:
        yield "hears is true when nobody has broadcast for 1.4 s"


@protocol_rule("elects nobody that it may not", _ELECTIONS)
def _elects(e: Evidence) -> Iterator[str]:
    """Its equipment is `no_compute`, and the coordinator is heard."""
    topics = {h.sample.topic for h in e.heard}
    for kind in ("election", "heartbeat", "conflict", "decision"):
        if f"{issuer_name(e.number)}/{kind}" in topics:
            yield f"it sent {kind}"
    if any(topic.startswith(f"{issuer_name(e.number)}/cmd/") for topic in topics):
        yield "it sent commands"


@protocol_rule(
    "tells what must outlive it, whenever that changes", "wire-format.md#persistentstate", LOCKSTEP
)
def _persistent(e: Evidence) -> Iterator[str]:
    """Terms as in the next broadcast, and the last command obeyed."""
    if e.last_tick < script.OBEYED.tick + 1:
        raise NotTriedError("the play did not come so far")
    kept = [*e.of(PersistentState)]
    for told in e.of(StateBroadcast):
        last = next((m for m in reversed(kept) if m.t_ns <= told.t_ns), None)
        known = (last.highest_term, last.mandate_term) if last else (0, 0)
        if known != (told.highest_term, told.mandate_term):
            terms = told.highest_term, told.mandate_term
            yield f"it broadcasts the terms {terms} when it has last kept {known}"
    applied = script.OBEYED.message.term, script.OBEYED.message.number
    if not any((m.applied_term, m.applied_number) == applied for m in kept):
        yield f"it never kept that it obeyed command {applied[1]} of term {applied[0]}"
    for one, two in pairwise(kept):
        if _state(one) == _state(two):
            yield f"it kept the same twice, at {two.t_ns / 1e9:g} s again"


def _state(m: PersistentState) -> tuple[int, int, int, int]:
    return m.highest_term, m.mandate_term, m.applied_term, m.applied_number


def _told(e: Evidence, tick: int) -> StateBroadcast:
    """The first broadcast of a tick or later."""
    told = e.broadcast(tick)
    if told is None:
        raise NotTriedError("the play did not come so far, or it did not broadcast")
    return told


def _mandate(told: StateBroadcast, term: int, *, valid: bool) -> Iterator[str]:
    if (told.mandate_term, told.mandate_valid) != (term, valid):
        yield (
            f"at {told.t_ns / 1e9:g} s its mandate is of term {told.mandate_term}, "
            f"{'in force' if told.mandate_valid else 'not in force'}, where it is of {term}, "
            f"{'in force' if valid else 'not in force'}"
        )


def _ignored(told: StateBroadcast, term: int) -> Iterator[str]:
    if told.highest_term >= term or told.mandate_term == term:
        yield f"it takes term {term} for one that has come about"
