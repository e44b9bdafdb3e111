"""A node runner: one participant's node between its inbox and its outbox, the same on every bus.

The node is pure: `step(now_ns, inbox) -> outbox`. The runner lets the faults of the plan act on
what arrives, holds it until it is due, hands it over in an order that does not depend on arrival,
and reports what came.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from fleet.faults.channel import Channel, Delivery
from fleet.faults.draws import LinkMessage, LinkMessageColumns
from fleet.faults.links import UNREADABLE
from fleet.faults.rules import Rule
from fleet.model.conflict.contact import INCARNATION
from fleet.model.conflict.track_table import TrackRow
from fleet.model.elementary import dist
from fleet.model.types import Array, Integers, Position
from fleet.node.altered import read_altered
from fleet.node.broadcasts import (
    BroadcastArrivals,
    Broadcasts,
    JudgedArrivals,
    Portion,
    Reception,
    take_in,
)
from fleet.node.holding import HoldingQueue, SortedQueue, Timing
from fleet.node.node import InboxMessage, Node
from fleet.node.step_report import StepReport
from fleet.protocol.account import Account
from fleet.protocol.messages import (
    Done,
    Message,
    StateBroadcast,
    Truth,
)
from fleet.protocol.topics import issuer_name


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
        self._report = StepReport(node, incarnation * INCARNATION, measured=self._measured)
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
        self._report.taken += due
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
                    self._report.failed.append((sent.t_ns, src, messages.kind, seq, cause))
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
            row = (message.t_ns, message.id, message.kind, message.seq, fate.dropped_by)
            self._report.failed.append(row)
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
                self._report.failed.append(row)
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
        if self.reporting:
            sent += self._report.messages(now_ns, inbox)
        self._report.clear()
        return sent

    def round_ns_with(self, message: Message) -> int:
        """How long the round took that was run in this step; its true state alone carries that."""
        return self.node.round_ns if isinstance(message, Truth) else 0

    def done(self, tick: int, now_ns: int, account: Account) -> Done:
        """The report that all of this has been sent: of a lockstep tick, or of a realtime run."""
        told = account.counts, account.digests
        return Done(self.node.id, max(tick, 0), now_ns, tick, *told)
