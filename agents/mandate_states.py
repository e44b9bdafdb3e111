"""How a UAV stands to elections, as data: the documents have their table from here."""

from __future__ import annotations

from enum import StrEnum

from fleet.model.election import Mandate


class MandateState(StrEnum):
    """What the election of the highest term that names this UAV means to it now."""

    NONE = "none"
    MEMBER = "member"
    COMPUTING = "computing"
    LAPSED = "lapsed"


class MandateEvent(StrEnum):
    """What may change that.

    A clock that is set back into the time of a mandate that has lapsed is as if it were heard anew.
    """

    NAMED = "an election of its term or a higher one names it, another UAV computes"
    APPOINTED = "an election of its term or a higher one appoints it as computing UAV"
    IGNORED = "an election of a lower term, of another group, or not its issuer's to announce"
    RUN_OUT = "its end passes, or the UAV's clock is set back to before it was heard"
    RESTARTED = "the UAV's process is started again"


STATE_MEANINGS = {
    MandateState.NONE: "no election that names it has been heard: every command is refused",
    MandateState.MEMBER: "it obeys the computing UAV of the mandate",
    MandateState.COMPUTING: "it runs rounds, and commands the members",
    MandateState.LAPSED: "it obeys nobody and commands nobody, and flies on what it has accepted",
}

MANDATE_STATES = {
    (state, event): after
    for state in MandateState
    for event, after in {
        MandateEvent.NAMED: MandateState.MEMBER,
        MandateEvent.APPOINTED: MandateState.COMPUTING,
        MandateEvent.IGNORED: state,
        MandateEvent.RUN_OUT: state if state is MandateState.NONE else MandateState.LAPSED,
        MandateEvent.RESTARTED: MandateState.NONE,
    }.items()
}
"""The state after each event in each state."""


def mandate_state(mandate: Mandate | None, own: int, now_ns: int) -> MandateState:
    """Where the UAV `own` stands at a time by its clock."""
    if mandate is None:
        return MandateState.NONE
    if not mandate.in_force(now_ns):
        return MandateState.LAPSED
    return MandateState.COMPUTING if mandate.computing == own else MandateState.MEMBER
