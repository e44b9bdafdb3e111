"""The delivery report of a step: what came to a node, and what a fault or the node let fail."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.model.words import ArrivalFate
from fleet.node.broadcasts import BroadcastArrivals
from fleet.node.node import InboxMessage, Node, delivery_order
from fleet.protocol.messages import DeliveryReport, Message, StateBroadcast

RECEIVED, ALTERED = ArrivalFate.RECEIVED.value, ArrivalFate.ALTERED.value
IMPLAUSIBLE = ArrivalFate.IMPLAUSIBLE.value

ReportRow = tuple[int, str, int, int, int, str]
"""Of a delivery report: source, class, number, times of sending and delivery in ns, fate."""


class StepReport:
    """Collects what comes of messages to a node in a step, for one report of it."""

    def __init__(self, node: Node, first_seq: int, *, measured: bool) -> None:
        """If `measured`, it tells of each message what zenoh took, and what faults added."""
        self._node = node
        self._measured = measured
        self._next_seq = first_seq
        self.taken: list[BroadcastArrivals] = []
        self.failed: list[tuple[int, int, str, int, str]] = []
        """Time of sending, source, class, number, and what dropped it or left it unreadable."""

    def clear(self) -> None:
        """The step is over."""
        self.taken.clear()
        self.failed.clear()

    def messages(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[DeliveryReport]:
        """The delivery report; none if nothing has come, as where one broadcasts alone."""
        if not (self.taken or inbox or self.failed):
            return []
        rows = [_row(*arrived) for arrivals in self.taken for arrived in arrivals.messages()]
        rows += [_row(i.original, i.delivered_ns, ALTERED if i.sent else RECEIVED) for i in inbox]
        if self.taken:
            rows.sort(key=_row_order)
        if self._node.implausible:
            rows = [self._judged_by_node(row) for row in rows]
        for t_ns, src, kind, seq, cause in sorted(self.failed):
            rows.append((src, kind, seq, t_ns, 0, cause))
        if not rows:
            return []
        self._next_seq += 1
        columns = zip(*rows, strict=True)
        measured: list[tuple[int, ...]] = []
        if self._measured:
            none = (0,) * len(self.failed)
            measured = [
                tuple(i.transit_ns for i in inbox) + none,
                tuple(i.delay_ns for i in inbox) + none,
                tuple(i.slip_ns for i in inbox) + none,
            ]
        return [DeliveryReport(self._node.id, self._next_seq - 1, now_ns, *columns, *measured)]

    def _judged_by_node(self, row: ReportRow) -> ReportRow:
        """The row of a message that has come; another fate if it is a broadcast not believed."""
        src, kind, seq = row[:3]
        doubted = kind == StateBroadcast.kind and (src, seq) in self._node.implausible
        return (*row[:-1], IMPLAUSIBLE) if doubted else row


def _row(sent: Message, delivered_ns: int, fate: str = RECEIVED) -> ReportRow:
    return sent.id, sent.kind, sent.seq, sent.t_ns, delivered_ns, fate


def _row_order(row: ReportRow) -> tuple[int, int, int, int]:
    src, kind, seq, _, delivered_ns, _ = row
    return delivery_order(delivered_ns, src, kind, seq)
