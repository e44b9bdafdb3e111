"""A station: one participant's node between its inbox and its outbox, the same on every bus.

The node is pure: `step(now_ns, inbox) -> outbox`. The station decodes what arrives, holds it until
it is due, hands it over in an order that does not depend on arrival, and encodes what is sent.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import Protocol

from msgspec import Struct

from fleet.comms import codec
from fleet.comms.keys import issuer_name, suffix_of, topic_of
from fleet.comms.messages import Delivery, Done, Message
from fleet.model.faults.channel import Channel
from fleet.model.faults.draws import Hop


class Incoming(Struct, frozen=True, gc=False):
    """A message and the moment at which it is delivered.

    `sent` is the message as it was sent, where a fault has altered what is delivered; `transit_ns`
    is what zenoh took, measured in realtime alone.
    """

    delivered_ns: int
    message: Message
    sent: Message | None = None
    transit_ns: int = 0

    @property
    def original(self) -> Message:
        """The message as it was sent."""
        return self.sent or self.message

    def order(self) -> tuple[int, int, str, int]:
        """Delivery order: time, source, class, sequence number."""
        m = self.original
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


class Timing(Protocol):
    """How the time of delivery follows from the time of sending: the difference of the clocks."""

    def delivered_ns(self, sent_ns: int, arrived_ns: int, delay_ns: int) -> int:
        """Delivery time of a message that a fault delays by `delay_ns`."""
        ...


class LockstepTiming(Struct, frozen=True):
    """Simulated time: the delay, but at least a tick (the lookahead); arrival plays no part."""

    tick_ns: int

    def delivered_ns(self, sent_ns: int, arrived_ns: int, delay_ns: int) -> int:
        """The delay after sending."""
        return sent_ns + max(delay_ns, self.tick_ns)


class RealtimeTiming(Struct, frozen=True):
    """Wall clocks: what zenoh took, and then the delay."""

    def delivered_ns(self, sent_ns: int, arrived_ns: int, delay_ns: int) -> int:
        """The delay after arrival."""
        return arrived_ns + delay_ns


Sent = list[tuple[str, bytes]]
"""Topics and payloads, in order of sending."""


class Station:
    """A node with its inbox."""

    def __init__(self, node: Node, timing: Timing, channel: Channel) -> None:
        self.node = node
        self.name = issuer_name(node.id)
        self.rejected = 0
        self._timing = timing
        self._channel = channel
        self._waiting: list[tuple[tuple[int, int, str, int], int, Incoming]] = []
        self._failed: list[tuple[int, int, str, int, str]] = []
        self._accepted = 0
        self._deliveries = 0

    def accept(
        self,
        topic: str,
        payload: bytes,
        arrived_ns: int = 0,
        message: Message | None = None,
        transit_ns: int = 0,
    ) -> None:
        """Take a message from the bus; one that is malformed or misattributed is counted, not used.

        (The range hears all messages too, and ends the run over such a one of a participant's.)

        `message` spares decoding where the bus has it decoded.
        """
        message = message or self._valid(topic, payload)
        if message is None or topic_of(message) != topic:
            self.rejected += 1
            return
        if self._channel.clean:
            delivered = self._timing.delivered_ns(message.t_ns, arrived_ns, 0)
            self._hold(Incoming(delivered, message, None, transit_ns))
            return
        hop = Hop(message.id, self.node.id, message.kind, message.seq, message.t_ns)
        fate = self._channel.fate(hop)
        if fate.dropped_by:
            self._failed.append((hop.t_ns, hop.src, hop.kind, hop.seq, fate.dropped_by))
        for passage in fate.passages:
            delivered = self._timing.delivered_ns(message.t_ns, arrived_ns, passage.delay_ns)
            incoming = Incoming(delivered, message, None, transit_ns)
            if passage.flips:
                altered = self._valid(topic, flipped(payload, passage.flips))
                if altered is None:
                    self._failed.append((hop.t_ns, hop.src, hop.kind, hop.seq, "corrupt"))
                    continue
                incoming = Incoming(delivered, altered, message, transit_ns)
            self._hold(incoming)

    def _hold(self, incoming: Incoming) -> None:
        self._accepted += 1
        heapq.heappush(self._waiting, (incoming.order(), self._accepted, incoming))

    def _valid(self, topic: str, payload: bytes) -> Message | None:
        """The message of a payload, if it is well-formed and belongs on its topic."""
        try:
            message = codec.decode(topic, payload)
        except ValueError:
            return None
        return message if topic_of(message) == topic else None

    def step(self, now_ns: int) -> Sent:
        """Step the node with all that is due by `now_ns`; returns what it sends, encoded."""
        inbox = []
        while self._waiting and self._waiting[0][2].delivered_ns <= now_ns:
            inbox.append(heapq.heappop(self._waiting)[2])
        sent = [(topic_of(m), codec.encode(m)) for m in self.node.step(now_ns, inbox)]
        if inbox or self._failed:
            report = self._delivery(now_ns, inbox)
            sent.append((topic_of(report), codec.encode(report)))
        return sent

    def done(self, tick: int, now_ns: int, sent: Sent) -> tuple[str, bytes]:
        """The report that closes a lockstep tick."""
        message = Done(self.node.id, max(tick, 0), now_ns, tick, counts(sent))
        return topic_of(message), codec.encode(message)

    def _delivery(self, now_ns: int, inbox: list[Incoming]) -> Delivery:
        self._deliveries += 1
        rows = [
            (
                m.id,
                m.kind,
                m.seq,
                m.t_ns,
                i.delivered_ns,
                "altered" if i.sent else "received",
                i.transit_ns,
            )
            for i, m in [(i, i.original) for i in inbox]
        ]
        for t_ns, src, kind, seq, cause in sorted(self._failed):
            rows.append((src, kind, seq, t_ns, 0, cause, 0))
        self._failed.clear()
        columns = zip(*rows, strict=True)
        return Delivery(self.node.id, self._deliveries - 1, now_ns, *columns)


def flipped(payload: bytes, places: Sequence[float]) -> bytes:
    """A payload with the bits at these places (fractions of its length) flipped."""
    out = bytearray(payload)
    for place in places:
        bit = int(place * 8 * len(out))
        out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def counts(sent: Sent) -> dict[str, int]:
    """Messages by topic without issuer, in the order of topics."""
    out: dict[str, int] = {}
    for topic, _ in sorted(sent):
        suffix = suffix_of(topic)
        out[suffix] = out.get(suffix, 0) + 1
    return out
