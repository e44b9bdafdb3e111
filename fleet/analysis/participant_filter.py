"""Which messages can be of a run: from its participants, about its UAVs, at its times.

A log is believed no further. What else it has, as of a stranger on the same network, is left out of
everything that is computed from it, and `fleet check` reports it.
"""

from __future__ import annotations

from msgspec import Struct, structs

from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.log.reader import Record
from fleet.model.types import COORDINATOR
from fleet.protocol import codec
from fleet.protocol.cells import is_cell
from fleet.protocol.classes import ADDRESSED, AUDIBLE
from fleet.protocol.messages import (
    Ack,
    Clock,
    Command,
    Conflict,
    Decision,
    DeliveryReport,
    Election,
    Message,
    StateBroadcast,
    Truth,
)
from fleet.protocol.topics import (
    cell_in,
    in_cells,
    issuer_name,
    issuer_of,
    suffix_of,
    topic_of,
)

_OF_UAVS = frozenset(m.kind for m in (StateBroadcast, Truth, Command, Ack, Decision))
"""Classes that UAVs alone send."""


class Address(Struct, frozen=True, gc=False):
    """Who sent to whom, as a topic tells it; `target` is -1 for messages to all."""

    issuer: int
    target: int = -1


REPORT_COLUMNS = (
    *("src", "kinds", "seqs", "sent_ns", "delivered_ns", "fates"),
    *("transit_ns", "delay_ns", "slip_ns"),
)


def _without(report: DeliveryReport, kinds: frozenset[str]) -> DeliveryReport:
    """A delivery report without its entries of these classes."""
    kept = [n for n, kind in enumerate(report.kinds) if kind not in kinds]
    columns = {name: getattr(report, name) for name in REPORT_COLUMNS}
    some = {name: tuple(values[n] for n in kept) for name, values in columns.items() if values}
    return structs.replace(report, **some)


class ParticipantFilter:
    """The participants of a scenario, and how long it lasts."""

    def __init__(self, scenario: Scenario, unknown: frozenset[str] = frozenset()) -> None:
        """`unknown` are classes that are not known here, which delivery reports may name."""
        self._unknown = unknown
        self.uavs = frozenset(u.id for u in uavs_of(scenario))
        coordinated = scenario.coordination.electors == "coordinator"
        self._nodes = self.uavs | ({COORDINATOR} if coordinated else frozenset())
        self._celled = scenario.cells() is not None
        self._end_ns = scenario.ticks * scenario.tick_ns
        self._names = {issuer_name(node): node for node in self._nodes}
        self._addresses: dict[str, Address | None] = {}

    def address(self, record: Record) -> Address | None:
        """Who sent a record to whom, without decoding it; None if that is nobody of this run."""
        topic = record.topic
        if topic not in self._addresses:
            self._addresses[topic] = self._parsed(topic)
        return self._addresses[topic] if record.sent_ns <= self._end_ns else None

    def decode(self, record: Record) -> Message | None:
        """The message of a record; None if it is malformed, or cannot be of this run."""
        if self.address(record) is None:
            return None
        try:
            message = codec.decode(record.topic, record.payload)
        except ValueError:
            return None
        if self._unknown and isinstance(message, DeliveryReport):
            message = _without(message, self._unknown)
        return message if self._belongs(message, record.topic) and self._has(message) else None

    def _belongs(self, message: Message, topic: str) -> bool:
        """Whether a message is on a topic of its own; in which cell its issuer was is not told."""
        cell = cell_in(topic) if self._celled and in_cells(message) else ""
        return topic_of(message, cell) == topic and (not cell or is_cell(cell))

    def clock(self, record: Record) -> Clock | None:
        """The grant of a record; None if it is malformed, or cannot be of this run."""
        try:
            clock = codec.decode_clock(record.payload)
        except ValueError:
            return None
        present = self._nodes.issuperset((*clock.held, *clock.down))
        return clock if present and clock.t_ns <= self._end_ns else None

    def _parsed(self, topic: str) -> Address | None:
        issuer = self._names.get(issuer_of(topic))
        if issuer is None:
            return None
        kind, _, target = suffix_of(topic).partition("/")
        if kind in _OF_UAVS and issuer not in self.uavs:
            return None
        if kind not in ADDRESSED:
            return Address(issuer)
        number = self._names.get(target, COORDINATOR)
        return Address(issuer, number) if number in self.uavs else None

    def _has(self, message: Message) -> bool:
        """Whether time and all whom a message names are of this run."""
        if message.t_ns > self._end_ns:
            return False
        match message:
            case Election():
                named = set(message.members)
                distinct = len(named) == len(message.members)
                return distinct and named <= self.uavs and message.computing in self.uavs
            case Decision():
                return all(e.target in self.uavs for e in message.encounters)
            case Conflict():
                return all(a != b and {a, b} <= self.uavs for a, b in message.pairs)
            case DeliveryReport():
                return self._nodes.issuperset(message.src) and AUDIBLE.issuperset(message.kinds)
        return True
