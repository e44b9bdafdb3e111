"""What becomes of a command, as its issuer knows, as data.

The documents have their table from here;
`agents/command_exchange.py` goes by it.
"""

from __future__ import annotations

from enum import StrEnum


class CommandState(StrEnum):
    """How far a command has come."""

    SENT = "sent"
    UNANSWERED = "unanswered"
    RECEIVED = "received"
    REFUSED = "refused"
    SUPERSEDED = "superseded"


class CommandEvent(StrEnum):
    """What may happen to it."""

    ACCEPTED = "accepted, refused as `duplicate`, or told by a broadcast to be flown"
    REFUSED = "refused for good"
    REFUSED_FOR_NOW = "refused, but a repetition may be accepted"
    EXPIRED = "its expiry has passed"
    NEXT_SENT = "another command is sent to the same UAV"
    NEW_TERM = "the issuer is elected in a new term"
    LATER_RECEIVED = "a later command is received"


COMMAND_MEANINGS = {
    CommandState.SENT: "on its way, and repeated",
    CommandState.UNANSWERED: "repeated no more; nobody knows whether it has arrived",
    CommandState.RECEIVED: "the UAV has it: what it flies, as far as the issuer knows",
    CommandState.REFUSED: "it never counts; the UAV goes by the one before",
    CommandState.SUPERSEDED: "the UAV goes by a later one",
}

_ANSWERED = {
    CommandEvent.ACCEPTED: CommandState.RECEIVED,
    CommandEvent.REFUSED: CommandState.REFUSED,
    CommandEvent.LATER_RECEIVED: CommandState.SUPERSEDED,
}
_GIVEN_UP = dict.fromkeys(
    (CommandEvent.EXPIRED, CommandEvent.NEXT_SENT, CommandEvent.NEW_TERM), CommandState.UNANSWERED
)
_CHANGES = {
    CommandState.SENT: _ANSWERED | _GIVEN_UP,
    CommandState.UNANSWERED: _ANSWERED,
    CommandState.RECEIVED: {CommandEvent.LATER_RECEIVED: CommandState.SUPERSEDED},
}

COMMAND_STATES = {
    (state, event): _CHANGES.get(state, {}).get(event, state)
    for state in CommandState
    for event in CommandEvent
}
"""The state after each event in each state."""
