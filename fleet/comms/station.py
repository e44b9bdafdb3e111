"""A station: one participant's node between its inbox and its outbox, the same on every bus.

The node is pure: `step(now_ns, inbox) -> outbox`. The station decodes what arrives, holds it until
it is due, hands it over in an order that does not depend on arrival, and encodes what is sent.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from msgspec import Struct

from fleet.comms import codec
from fleet.comms.keys import issuer_name, suffix_of, topic_of
from fleet.comms.messages import Delivery, Done, Message


class Incoming(Struct, frozen=True):
    """A message and the moment at which it is delivered."""

    delivered_ns: int
    message: Message

    def order(self) -> tuple[int, int, str, int]:
        """Delivery order: time, source, class, sequence number."""
        m = self.message
        return (self.delivered_ns, m.id, m.kind, m.seq)


class Node(Protocol):
    """A participant: a UAV or the coordinator."""

    @property
    def id(self) -> int:
        """Its number in messages."""
        ...

    @property
    def hears(self) -> tuple[str, ...]:
        """Topic suffixes that it receives, from any issuer."""
        ...

    def step(self, now_ns: int, inbox: Sequence[Incoming]) -> list[Message]:
        """Advance to `now_ns`, taking in what was delivered since, and return what to send."""
        ...


class Link(Protocol):
    """When a message is delivered to a receiver: where communication faults act."""

    def deliveries(self, message: Message, receiver: int, arrived_ns: int) -> Sequence[int]:
        """Delivery times; none if the message is lost, several if it is duplicated."""
        ...


@dataclass(frozen=True, slots=True)
class LockstepLink:
    """Perfect communication in simulated time: the tick is the least latency (the lookahead)."""

    tick_ns: int

    def deliveries(self, message: Message, receiver: int, arrived_ns: int) -> Sequence[int]:
        """One tick after sending; the time of arrival plays no part."""
        return (message.t_ns + self.tick_ns,)


class RealtimeLink:
    """Perfect communication in real time: delivered on arrival."""

    def deliveries(self, message: Message, receiver: int, arrived_ns: int) -> Sequence[int]:
        """On arrival."""
        return (arrived_ns,)


Sent = list[tuple[str, bytes]]
"""Topics and payloads, in order of sending."""


class Station:
    """A node with its inbox."""

    def __init__(self, node: Node, link: Link) -> None:
        self.node = node
        self.name = issuer_name(node.id)
        self.rejected = 0
        self._link = link
        self._waiting: list[tuple[tuple[int, int, str, int], int, Incoming]] = []
        self._accepted = 0
        self._deliveries = 0

    def accept(
        self, topic: str, payload: bytes, arrived_ns: int = 0, message: Message | None = None
    ) -> None:
        """Take a message from the bus; one that is malformed or misattributed is counted, not used.

        `message` spares decoding where the bus has it decoded.
        """
        if message is None:
            try:
                message = codec.decode(topic, payload)
            except ValueError:
                self.rejected += 1
                return
        if topic_of(message) != topic:
            self.rejected += 1
            return
        for delivered_ns in self._link.deliveries(message, self.node.id, arrived_ns):
            incoming = Incoming(delivered_ns, message)
            self._accepted += 1
            heapq.heappush(self._waiting, (incoming.order(), self._accepted, incoming))

    def step(self, now_ns: int) -> Sent:
        """Step the node with all that is due by `now_ns`; returns what it sends, encoded."""
        inbox = []
        while self._waiting and self._waiting[0][2].delivered_ns <= now_ns:
            inbox.append(heapq.heappop(self._waiting)[2])
        sent = [(topic_of(m), codec.encode(m)) for m in self.node.step(now_ns, inbox)]
        if inbox:
            report = self._delivery(now_ns, inbox)
            sent.append((topic_of(report), codec.encode(report)))
        return sent

    def done(self, tick: int, now_ns: int, sent: Sent) -> tuple[str, bytes]:
        """The report that closes a lockstep tick."""
        message = Done(self.node.id, max(tick, 0), now_ns, tick, counts(sent))
        return topic_of(message), codec.encode(message)

    def _delivery(self, now_ns: int, inbox: list[Incoming]) -> Delivery:
        self._deliveries += 1
        messages = [i.message for i in inbox]
        return Delivery(
            self.node.id,
            self._deliveries - 1,
            now_ns,
            tuple([m.id for m in messages]),
            tuple([m.kind for m in messages]),
            tuple([m.seq for m in messages]),
            tuple([m.t_ns for m in messages]),
            tuple([i.delivered_ns for i in inbox]),
        )


def counts(sent: Sent) -> dict[str, int]:
    """Messages by topic without issuer, in the order of topics."""
    out: dict[str, int] = {}
    for topic, _ in sorted(sent):
        suffix = suffix_of(topic)
        out[suffix] = out.get(suffix, 0) + 1
    return out
