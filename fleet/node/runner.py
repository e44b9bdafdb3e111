"""A node runner: one participant's node between its inbox and its outbox, the same on every bus.

The node is pure: `step(now_ns, inbox) -> outbox`. The runner lets the faults of the plan act on
what arrives, holds it until it is due, hands it over in an order that does not depend on arrival,
and reports what came.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Annotated, ClassVar, Protocol

import numpy as np
from msgspec import Meta, Struct

from fleet.faults.channel import Channel, Delivery
from fleet.faults.draws import LinkMessage, LinkMessageColumns
from fleet.faults.links import UNREADABLE
from fleet.faults.rules import Rule
from fleet.model.conflict.contact import INCARNATION
from fleet.model.conflict.track_table import TrackRow
from fleet.model.elementary import dist
from fleet.model.types import Array, Integers, Position
from fleet.model.words import ArrivalFate
from fleet.node.broadcasts import (
    BroadcastArrivals,
    Broadcasts,
    JudgedArrivals,
    Portion,
    Receiver,
    Reception,
    take_in,
)
from fleet.protocol import codec
from fleet.protocol.account import Account
from fleet.protocol.bounds import TimeNs
from fleet.protocol.classes import DELIVERY_ORDER
from fleet.protocol.messages import (
    DeliveryReport,
    Done,
    Message,
    PersistentState,
    StateBroadcast,
    Truth,
)
from fleet.protocol.topics import cell_in, issuer_name, topic_of

_RANK = {kind: n for n, kind in enumerate(DELIVERY_ORDER)}
RECEIVED, ALTERED = ArrivalFate.RECEIVED.value, ArrivalFate.ALTERED.value
IMPLAUSIBLE = ArrivalFate.IMPLAUSIBLE.value

ReportRow = tuple[int, str, int, int, int, str]
"""Of a delivery report: source, class, number, times of sending and delivery in ns, fate."""


MOST_INCARNATIONS = 10**6
"""So often a process may be started again: each incarnation has numbers of its own."""


class RestartState(Struct, frozen=True, gc=False):
    """What a process that is started again finds: how often it has been, its memory, its state."""

    incarnation: Annotated[int, Meta(ge=0, le=MOST_INCARNATIONS)]
    t_ns: TimeNs
    memory: PersistentState | None = None
    truth: Truth | None = None


class InboxMessage(Struct, frozen=True, gc=False):
    """A message and the moment at which it is delivered.

    `sent` is the message as it was sent, where a fault has altered what is delivered. Measured in
    realtime alone: `transit_ns`, what zenoh took; `delay_ns`, what faults were to add; `slip_ns`,
    how much later than that it was delivered.
    """

    delivered_ns: int
    message: Message
    sent: Message | None = None
    transit_ns: int = 0
    delay_ns: int = 0
    slip_ns: int = 0

    @property
    def original(self) -> Message:
        """The message as it was sent."""
        return self.sent or self.message

    def order(self) -> tuple[int, int, int, int]:
        """Delivery order: time, source, class, sequence number."""
        m = self.original
        return (self.delivered_ns, m.id, _RANK.get(m.kind, len(_RANK)), m.seq)


class Node(Receiver, Protocol):
    """A participant: a UAV or the coordinator."""

    stopwatch: Callable[[], int]
    """The time in ns by which it measures how long it computes; in memory it stands still."""

    round_ns: int
    """How long the round of the resolver took that it ran in its last step; 0 if none."""

    @property
    def doing(self) -> str:
        """What it is about in a step, in words, should that not end."""
        ...

    @property
    def takes_together(self) -> bool:
        """Whether broadcasts that come together may be taken in before it steps."""
        ...

    @property
    def hears(self) -> tuple[str, ...]:
        """Topic suffixes that it receives, from any issuer."""
        ...

    @property
    def position_ned_m(self) -> Position:
        """Where its radio is."""
        ...

    @property
    def implausible(self) -> Collection[tuple[int, int]]:
        """Broadcasts (source, seq) that it found implausible in its last step, or before it."""
        ...

    def step(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[Message]:
        """Advance to `now_ns`, taking in what was delivered since, and return what to send.

        Of the broadcasts, some may have been taken in already (`fleet.node.broadcasts.take_in`).
        """
        ...

    def replan(self, plan: Sequence[Rule]) -> None:
        """Suffer from another fault plan from now on."""
        ...


class Timing(Protocol):
    """How the time of delivery follows from the time of sending: the difference of the clocks.

    It may go `by_arrival`, or else all that is sent at one time is delivered at one time.
    """

    by_arrival: ClassVar[bool]

    def delivered_ns(self, sent_ns: int, arrived_ns: int, delay_ns: int) -> int:
        """Delivery time of a message that a fault delays by `delay_ns`."""
        ...


class HoldingQueue(Protocol):
    """Holds messages until they are due."""

    def hold(self, incoming: InboxMessage) -> None:
        """Take a message that is due at its `delivered_ns`."""
        ...

    def due(self, now_ns: int) -> list[InboxMessage]:
        """What has become due by `now_ns`, in order of delivery."""
        ...


class SortedQueue:
    """Simulated time: by time, source, class and sequence number, whenever it arrived."""

    def __init__(self) -> None:
        self._waiting: list[InboxMessage] = []

    def hold(self, incoming: InboxMessage) -> None:
        """Take a message."""
        self._waiting.append(incoming)

    def due(self, now_ns: int) -> list[InboxMessage]:
        """What has become due, in order."""
        due = [i for i in self._waiting if i.delivered_ns <= now_ns]
        if due:
            self._waiting = [i for i in self._waiting if i.delivered_ns > now_ns]
            due.sort(key=InboxMessage.order)
        return due


class LockstepTiming(Struct, frozen=True):
    """Simulated time: the delay, but at least a tick (the lookahead); arrival plays no part."""

    tick_ns: int
    by_arrival: ClassVar[bool] = False

    def delivered_ns(self, sent_ns: int, _arrived_ns: int, delay_ns: int) -> int:
        """The delay after sending."""
        return sent_ns + max(delay_ns, self.tick_ns)


class RealtimeTiming(Struct, frozen=True):
    """Wall clocks: what zenoh took, and then the delay."""

    by_arrival: ClassVar[bool] = True

    def delivered_ns(self, _sent_ns: int, arrived_ns: int, delay_ns: int) -> int:
        """The delay after arrival."""
        return arrived_ns + delay_ns


class NodeRunner:
    """A node with its inbox; unless it is `reporting`, it makes no delivery reports."""

    def __init__(
        self,
        node: Node,
        timing: Timing,
        channel: Channel,
        holding: HoldingQueue | None = None,
        *,
        incarnation: int = 0,
        credible: Callable[[Message, int], bool] = lambda *_: True,
    ) -> None:
        """Without `holding` messages are held in simulated time; `incarnation` counts restarts.

        What flipped bits have made of a message is read only if it is `credible` by the time of
        sending.
        """
        self.node = node
        self.name = issuer_name(node.id)
        self._credible = credible
        self._timing = timing
        self._channel = channel
        self._measured = holding is not None
        self._one_by_one = self._measured or timing.by_arrival or not node.takes_together
        self._holding = holding or SortedQueue()
        self._arrived: list[Reception] = []
        self._portions: list[Portion] = []
        self._arrivals: list[BroadcastArrivals] = []
        self._taken: list[BroadcastArrivals] = []
        self._failed: list[tuple[int, int, str, int, str]] = []
        self._deliveries = incarnation * INCARNATION
        self._together = self._can_together()
        self.reporting = True

    @property
    def place(self) -> Position | None:
        """Where the node's radio is, if a fault makes that matter."""
        return self.node.position_ned_m if self._channel.measures_distance else None

    @property
    def reads_payloads(self) -> bool:
        """Whether a fault may look at the payloads of what comes."""
        return self._channel.reads_payloads

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another fault plan: what was sent before is judged by its rules' windows."""
        self._channel.replan(plan)
        self.node.replan(plan)
        self._together = self._can_together()

    def _can_together(self) -> bool:
        """Whether broadcasts of one time are judged and taken in together."""
        if self._one_by_one:
            return False
        many = isinstance(self.node.tracks, TrackRow) and self._channel.judges_together
        return many or self._channel.clean

    def accept_together(self, portion: Portion) -> None:
        """Take what it hears of broadcasts that others hear as well."""
        if self._together:
            self._portions.append(portion)
            return
        for reception in portion.receptions(self.node.id):
            self.accept(reception)

    def accept(self, arrived: Reception) -> None:
        """Take a message of the run (see `fleet.node.gate`)."""
        message = arrived.message
        if isinstance(message, StateBroadcast) and self._together:
            if not (self._portions and self._portions[-1].broadcasts.add(arrived, message)):
                self._portions.append(Portion(Broadcasts(message.t_ns)))
                self._portions[-1].broadcasts.add(arrived, message)
        elif self._channel.clean:
            self._deliver(message, None, arrived.arrived_ns, 0, arrived.transit_ns)
        elif self._measured:
            self._judge(arrived)
        else:
            self._arrived.append(arrived)  # queues need them in order of sending

    def due_together(self, now_ns: int) -> list[BroadcastArrivals]:
        """Broadcasts that have become due, and that the node will have taken in when it steps."""
        if not (self._portions or self._arrivals):
            return []
        portions, self._portions = self._portions, []
        for portion in portions:
            if self._together:
                self._arrivals.append(self._judged(portion))
            else:
                self.accept_together(portion)  # the plan has changed since it came
        due, later = list[BroadcastArrivals](), list[BroadcastArrivals]()
        for arrivals in self._arrivals:
            now, then = arrivals.due(now_ns)
            due += [now] if now else []
            later += [then] if then else []
        self._arrivals = later
        self._taken += due
        return due

    def _judged(self, portion: Portion) -> BroadcastArrivals:
        """Let the fault plan act on broadcasts."""
        sent = portion.broadcasts
        if self._channel.clean:
            at_ns = self._timing.delivered_ns(sent.t_ns, 0, 0)
            return BroadcastArrivals(portion, self.node.id, at_ns)
        places = portion.places(self.node.id)
        messages = LinkMessageColumns(
            sent.issuers[places],
            self.node.id,
            StateBroadcast.kind,
            sent.reports.seq[places],
            sent.t_ns,
            sent.bits[places],
            self._distances_m(sent, places) if self._channel.measures_distance else None,
        )
        fates = self._channel.fates(messages)
        if self.reporting:
            rows = zip(messages.src.tolist(), messages.seq.tolist(), fates.dropped_by, strict=True)
            for src, seq, cause in rows:
                if cause:
                    self._failed.append((sent.t_ns, src, messages.kind, seq, cause))
        delivered = [
            self._timing.delivered_ns(sent.t_ns, 0, delay_ns)
            for delay_ns in fates.delay_ns[fates.arrives].tolist()
        ]
        return JudgedArrivals(sent, places[fates.arrives], np.array(delivered, dtype=np.int64))

    def _distances_m(self, sent: Broadcasts, places: Integers) -> Array:
        here, told = self.node.position_ned_m, [sent.receptions[n].place for n in places.tolist()]
        return np.array([math.nan if there is None else dist(there, here) for there in told])

    def _judge(self, arrived: Reception) -> None:
        """Let the fault plan act on a message."""
        message = arrived.message
        link_message = LinkMessage(
            message.id,
            self.node.id,
            message.kind,
            message.seq,
            message.t_ns,
            8 * len(arrived.payload),
            dist(arrived.place, self.node.position_ned_m) if arrived.place else None,
        )
        fate = self._channel.fate(link_message)
        if fate.dropped_by:
            self._failed.append(
                (
                    link_message.t_ns,
                    link_message.src,
                    link_message.kind,
                    link_message.seq,
                    fate.dropped_by,
                )
            )
        for delivery in fate.deliveries:
            self._pass(arrived, delivery)

    def _pass(self, arrived: Reception, delivery: Delivery) -> None:
        message, altered = arrived.message, None
        if delivery.flips:
            sent_ns = message.t_ns
            altered = read_altered(
                arrived.topic, arrived.payload, delivery.flips, self._credible, sent_ns
            )
            if altered is None:
                row = (message.t_ns, message.id, message.kind, message.seq, UNREADABLE)
                self._failed.append(row)
                return
        self._deliver(message, altered, arrived.arrived_ns, delivery.delay_ns, arrived.transit_ns)

    def _deliver(
        self,
        sent: Message,
        altered: Message | None,
        arrived_ns: int,
        delay_ns: int,
        transit_ns: int,
    ) -> None:
        delivered = self._timing.delivered_ns(sent.t_ns, arrived_ns, delay_ns)
        original = sent if altered else None
        self._holding.hold(InboxMessage(delivered, altered or sent, original, transit_ns, delay_ns))

    def step(self, now_ns: int) -> list[Message]:
        """Step the node with all that is due by `now_ns`; returns what it sends, in order."""
        due = self.due_together(now_ns)
        if due:
            take_in([self.node], [due], now_ns)
        if self._arrived:
            self._arrived.sort(key=Reception.order)
            for arrived in self._arrived:
                self._judge(arrived)
            self._arrived.clear()
        inbox = self._holding.due(now_ns)
        sent = [*self.node.step(now_ns, inbox)]
        if self.reporting and (self._taken or inbox or self._failed):
            sent += self._delivery(now_ns, inbox)
        self._taken.clear()
        self._failed.clear()
        return sent

    def round_ns_with(self, message: Message) -> int:
        """How long the round took that was run in this step; its true state alone carries that."""
        return self.node.round_ns if isinstance(message, Truth) else 0

    def done(self, tick: int, now_ns: int, account: Account) -> Done:
        """The report that all of this has been sent: of a lockstep tick, or of a realtime run."""
        told = account.counts, account.digests
        return Done(self.node.id, max(tick, 0), now_ns, tick, *told)

    def _delivery(self, now_ns: int, inbox: list[InboxMessage]) -> list[DeliveryReport]:
        """The delivery report; none if nothing has come, as where one broadcasts alone."""
        rows = [_row(*arrived) for arrivals in self._taken for arrived in arrivals.messages()]
        rows += [_row(i.original, i.delivered_ns, ALTERED if i.sent else RECEIVED) for i in inbox]
        if self._taken:
            rows.sort(key=_row_order)
        if self.node.implausible:
            rows = [self._judged_by_node(row) for row in rows]
        for t_ns, src, kind, seq, cause in sorted(self._failed):
            rows.append((src, kind, seq, t_ns, 0, cause))
        if not rows:
            return []
        self._deliveries += 1
        columns = zip(*rows, strict=True)
        measured: list[tuple[int, ...]] = []
        if self._measured:
            none = (0,) * len(self._failed)
            measured = [
                tuple(i.transit_ns for i in inbox) + none,
                tuple(i.delay_ns for i in inbox) + none,
                tuple(i.slip_ns for i in inbox) + none,
            ]
        return [DeliveryReport(self.node.id, self._deliveries - 1, now_ns, *columns, *measured)]

    def _judged_by_node(self, row: ReportRow) -> ReportRow:
        """The row of a message that has come; another fate if it is a broadcast not believed."""
        src, kind, seq = row[:3]
        doubted = kind == StateBroadcast.kind and (src, seq) in self.node.implausible
        return (*row[:-1], IMPLAUSIBLE) if doubted else row


def _row(sent: Message, delivered_ns: int, fate: str = RECEIVED) -> ReportRow:
    return sent.id, sent.kind, sent.seq, sent.t_ns, delivered_ns, fate


def _row_order(row: ReportRow) -> tuple[int, int, int, int]:
    """As `InboxMessage.order`."""
    src, kind, seq, _, delivered_ns, _ = row
    return delivered_ns, src, _RANK.get(kind, len(_RANK)), seq


def read_altered(
    topic: str,
    payload: bytes,
    flips: Sequence[float],
    believe: Callable[[Message, int], bool],
    sent_ns: int,
) -> Message | None:
    """What flipped bits make of a message, if it can still be taken for one of its topic."""
    try:
        message = codec.decode(topic, flipped(payload, flips))
    except ValueError:
        return None
    own = topic_of(message, cell_in(topic)) == topic
    return message if own and believe(message, sent_ns) else None


def flipped(payload: bytes, places: Sequence[float]) -> bytes:
    """A payload with the bits at these places (fractions of its length) flipped."""
    out = bytearray(payload)
    for place in places:
        bit = int(place * 8 * len(out))
        out[bit // 8] ^= 1 << bit % 8
    return bytes(out)
