"""The gate: which of all that arrives is a message of the run. Every receiver goes by the same one.

The bus is open: anybody can put anything on it. What no participant can have sent is not used.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from fleet.config.scenario import Scenario
from fleet.config.traffic import participants
from fleet.protocol import codec
from fleet.protocol.attendance import AWAY, OUT_OF_ORDER
from fleet.protocol.classes import ADDRESSED, MESSAGE_BY_KIND, issues_class
from fleet.protocol.messages import Done, Election, Heartbeat, Message, StateBroadcast
from fleet.protocol.sample import (
    ATTACHMENT,
    DELETION,
    KEY_LENGTH,
    KEYS_KEPT,
    SEVERAL,
    Sample,
)
from fleet.protocol.topics import cell_in, in_cells, issuer_name, issuer_of, suffix_of, topic_of

FUTURE_TOLERANCE_NS = 5_000_000_000
"""Realtime: a message may be from a clock that is so far ahead, and no further."""

STRANGER = "stranger"
HARMLESS = frozenset({STRANGER, SEVERAL, DELETION})
"""Not in the name of one participant, or no message at all: nobody uses it, the run goes on."""

REFUSAL_TEXTS: dict[str, str] = {
    STRANGER: "its issuer takes no part in the run",
    SEVERAL: "its key names several topics or another run",
    DELETION: "it is a deletion, not a message",
    ATTACHMENT: "a time or place in its attachment is out of bounds",
    "malformed": "it is no message of the class that its topic names",
    "misattributed": "it belongs on another topic",
    "future": "it was sent in the future, or its issuer's clock is more than 5 s ahead",
    "term": "so high a term cannot have come about yet",
    "repeated": "its number is not above the last one on this topic",
    "unaccounted": "its issuer does not say that it sent this",
    "out of turn": "its issuer is not due to report; somebody takes part twice in its name",
    AWAY: "its issuer was stopped or dead then",
    OUT_OF_ORDER: "its number or its time does not follow its issuer's last one",
    "not the simulation": "somebody else speaks in the name of the simulation",
}
"""Why something is refused, in a word, and what that means."""


class RefusedError(Exception):
    """What arrived is not a message of the run; `why` is one of `REASONS`."""

    def __init__(self, why: str) -> None:
        super().__init__(REFUSAL_TEXTS[why])
        self.why = why


class TopicParts(Struct, frozen=True, gc=False):
    """What a topic says: the number of its issuer (None: a stranger), the class, all but issuer.

    `issues` says whether such an issuer ever sends messages of that class, to such a target.
    """

    issuer: int | None
    kind: str
    suffix: str
    issues: bool


class Gate:
    """Lets the messages of the participants of one run through.

    `latest_ns` is the time after which nothing can have been sent yet. Whoever takes the messages
    of a topic as they come sees their numbers rise (`rising`).
    """

    def __init__(self, scenario: Scenario, *, rising: bool = False) -> None:
        self._numbers = {issuer_name(n): n for n in participants(scenario)}
        self._parts: dict[str, TopicParts] = {}
        self.names = frozenset(self._numbers)
        self.latest_ns = 0
        self.credible = credible(scenario)
        self._cells = scenario.cells()
        self._rising = rising
        self._last: dict[str, int] = {}

    def admit(self, arrival: Sample) -> Message:
        """The message that arrived; raises RefusedError."""
        topic = arrival.topic
        if arrival.flaw == SEVERAL:
            raise RefusedError(SEVERAL)
        parts = self._parts.get(topic) or self._parts_of(topic)
        if parts.issuer is None:
            raise RefusedError(STRANGER)
        if arrival.flaw:
            raise RefusedError(arrival.flaw)
        try:
            message = codec.decode_as(parts.kind, arrival.payload)
        except ValueError as error:
            raise RefusedError("malformed") from error
        own = parts.issues and message.id == parts.issuer
        if not own or self._suffix(message, arrival) != parts.suffix:
            raise RefusedError("misattributed")
        if message.t_ns > self.latest_ns:
            raise RefusedError("future")
        if not self.credible(message, message.t_ns):
            raise RefusedError("term")
        if self._rising and not isinstance(message, Done):
            counted = topic_of(message)
            if message.seq <= self._last.get(counted, -1):
                raise RefusedError("repeated")
            self._last[counted] = message.seq
        return message

    def _parts_of(self, topic: str) -> TopicParts:
        """What a topic says; kept if it is of a participant, as far as there is room for it."""
        number, kind = self._numbers.get(issuer_of(topic)), codec.kind_of(topic)
        # a class that nobody knows is malformed
        issues = number is None or kind not in MESSAGE_BY_KIND or issues_class(number, kind)
        nobody = kind in ADDRESSED and cell_in(topic) not in self.names
        parts = TopicParts(number, kind, suffix_of(topic), issues and not nobody)
        known = parts.issuer is not None and len(topic) <= KEY_LENGTH
        if known and len(self._parts) < KEYS_KEPT:
            self._parts[topic] = parts
        return parts

    def _suffix(self, message: Message, arrival: Sample) -> str:
        """The topic of a message but its issuer, by its content and where its issuer was.

        Empty, as no topic is, if it is in a cell and does not say where its issuer was.
        """
        if self._cells is None or not in_cells(message):
            return message.suffix
        return f"{message.kind}/{self._cells.name(arrival.place)}" if arrival.place else ""


def credible(scenario: Scenario) -> Callable[[Message, int], bool]:
    """Whether a message that was sent at a time has terms that can have come about by then.

    In a tick an elector begins a term for each group at most, and those of another in the same tick
    are not known to it; so the highest term rises by less than the square of the electors' number.
    """
    electors = len(participants(scenario)) + 1
    rise, tick_ns = electors * electors, scenario.tick_ns

    def possible(message: Message, sent_ns: int) -> bool:
        match message:
            case StateBroadcast():
                term = max(message.highest_term, message.mandate_term)
            case Heartbeat():
                term = message.highest_term
            case Election():
                term = message.term
            case _:
                return True
        return term <= rise * (sent_ns // tick_ns + 2)

    return possible
