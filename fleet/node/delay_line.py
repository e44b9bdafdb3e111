"""Realtime: one thread that hands each message over when its injected delay is up.

A thread of its own, so that a delay is no multiple of the tick and what it came to can be measured:
every message carries how much later than intended it was handed over.
"""

from __future__ import annotations

import ctypes
import heapq
import sys
import threading
import time
from collections.abc import Callable
from typing import Self

import msgspec

from fleet.node.node import InboxMessage

_PR_SET_TIMERSLACK = 29
_LEAST_SLACK_NS = 1


class DelayLine:
    """Holds messages until they are due on the wall clock; a context that ends its thread."""

    def __init__(self, now_ns: Callable[[], int] = time.time_ns) -> None:
        self.epoch_ns = self.phase_ns = 0
        self._now_ns = now_ns
        self._changed = threading.Condition()
        self._waiting: list[tuple[int, int, InboxMessage]] = []
        self._released: list[InboxMessage] = []
        self._count = 0
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="delay line", daemon=True)

    def __enter__(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End it; what still waits is dropped."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def hold(self, incoming: InboxMessage) -> None:
        """Take a message; without a delay it is handed over at once."""
        with self._changed:
            if incoming.delay_ns <= 0:
                self._released.append(incoming)
                return
            self._count += 1
            due_ns = max(incoming.delivered_ns, self._since_epoch_ns())
            heapq.heappush(self._waiting, (due_ns, self._count, incoming))
            if self._waiting[0][1] == self._count:
                self._changed.notify()

    def due(self, now_ns: int) -> list[InboxMessage]:
        """What has been handed over by `now_ns`, in order of delivery."""
        with self._changed:
            out = sorted(
                (i for i in self._released if i.delivered_ns <= now_ns), key=InboxMessage.order
            )
            self._released = [i for i in self._released if i.delivered_ns > now_ns]
        return sorted(out, key=InboxMessage.order)

    def _since_epoch_ns(self) -> int:
        """Simulated time here, by which steps are due: behind the wall clock's by the phase."""
        return self._now_ns() - self.epoch_ns - self.phase_ns

    def _run(self) -> None:
        _reduce_timer_slack()
        with self._changed:
            while not self._ended:
                now_ns = self._since_epoch_ns()
                while self._waiting and self._waiting[0][0] <= now_ns:
                    due_ns, _, incoming = heapq.heappop(self._waiting)
                    slip_ns = now_ns - due_ns
                    delivered_ns = incoming.delivered_ns + slip_ns
                    self._released.append(
                        msgspec.structs.replace(
                            incoming, delivered_ns=delivered_ns, slip_ns=slip_ns
                        )
                    )
                ahead_ns = self._waiting[0][0] - now_ns if self._waiting else None
                self._changed.wait(None if ahead_ns is None else ahead_ns / 1e9)


def _reduce_timer_slack() -> None:
    """Linux rounds the waits of a thread up by 50 us, to save power."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _LEAST_SLACK_NS)
