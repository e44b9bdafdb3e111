"""The transport over zenoh: participants are processes, and anybody may speak on the bus.

So what comes is let through by the gate, counted until everybody is done, and held against what its
issuers say that they sent.
"""

from __future__ import annotations

from collections.abc import Iterable

from fleet.node.clock_words import READY
from fleet.protocol.messages import Clock, Done
from fleet.protocol.topics import CLOCK, EVERYTHING, issuer_of
from fleet.simulation.listener import Listener
from fleet.simulation.tick_barrier import TickBarrier
from fleet.transport.interface import ReceivedMessage
from fleet.transport.zenoh_bus import Bus


class ZenohTransport:
    """Implements `fleet.transport.interface.Transport`."""

    def __init__(
        self, bus: Bus, listener: Listener, barrier: TickBarrier, numbers: Iterable[int]
    ) -> None:
        """`numbers` are those of all participants."""
        self._bus = bus
        self._listener = listener
        self._barrier = barrier
        self._numbers = tuple(numbers)
        self._tick, self._now_ns = READY, 0
        self._heard: list[ReceivedMessage] = []

    def await_ready(self, numbers: Iterable[int], now_ns: int) -> None:
        """Wait until these processes have joined."""
        self._barrier.expect(numbers)
        self._listener.audit(self._gathered(READY, now_ns))
        self._barrier.joining = False

    def grant(self, clock: Clock, payload: bytes) -> None:
        """Say the clock; everybody who is not stopped or dead is awaited."""
        self._tick, self._now_ns = clock.tick, clock.t_ns
        self._barrier.expect(set(self._numbers).difference(clock.held, clock.down))
        self._say(payload)

    def collect(self) -> list[ReceivedMessage]:
        """All messages of the tick: until everybody is done and all that they sent has come."""
        self._heard = self._gathered(self._tick, self._now_ns)
        return self._heard

    def audit(self, *, last: bool = False) -> None:
        """Hold all messages of the tick against what their issuers say that they sent."""
        late = self._bus.waiting(EVERYTHING) if last else ()
        found = (self._listener.hear(arrival, self._now_ns) for arrival in late)
        self._listener.audit([*self._heard, *(item for item in found if item)])

    def stop(self, _clock: Clock, payload: bytes) -> None:
        """Say that the run is over."""
        self._say(payload)

    def _say(self, payload: bytes) -> None:
        self._barrier.words.say(CLOCK, payload)
        self._bus.put(CLOCK, payload)

    def _gathered(self, tick: int, now_ns: int) -> list[ReceivedMessage]:
        owed, barrier, listener = 0, self._barrier, self._listener
        items = barrier.items = list[ReceivedMessage]()
        while barrier.waiting or owed > 0:
            item = listener.hear(self._bus.take(EVERYTHING), now_ns)
            if item is None:
                continue
            items.append(item)
            owed -= 1
            message = item[2]
            if isinstance(message, Done):
                if issuer_of(item[0]) not in barrier.waiting or message.tick != tick:
                    raise listener.intrusion(item[0], "out of turn")
                barrier.heard(issuer_of(item[0]))
                owed += sum(message.sent.values()) + 1
        barrier.busy = False
        return items
