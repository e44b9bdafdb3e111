"""When a message is delivered, and what holds it until then, in simulated time and in realtime."""

from __future__ import annotations

from typing import ClassVar, Protocol

from msgspec import Struct

from fleet.node.node import InboxMessage


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
