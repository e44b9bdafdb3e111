"""Waiting for those whom others start: who is missing is told, and nobody is waited for in vain."""

from __future__ import annotations

import sys
import time

from fleet.config.uav_numbers import ranges_of
from fleet.simulation.tick_barrier import TickBarrier


class JoinWait:
    """Tells who has not joined yet, and when nobody has joined for too long; polled, on a thread.

    Each who joins renews the time.
    """

    def __init__(self, run: str, barrier: TickBarrier, timeout_s: float) -> None:
        """`timeout_s` is how long to wait for the next one."""
        self._run = run
        self._barrier = barrier
        self._timeout_s = timeout_s
        self._missing: set[str] = set()

    def over(self) -> str:
        """Why there is no more waiting; empty as long as there is, or when all are there."""
        barrier = self._barrier
        missing = set(barrier.waiting)
        if not barrier.joining or not missing:
            return ""
        if missing != self._missing:
            self._missing = missing
            barrier.moved()
            print(f"fleet: run {self._run}: {self._words()}", file=sys.stderr, flush=True)
        if time.monotonic() - barrier.moved_s <= self._timeout_s:
            return ""
        return f"nobody joined for {self._timeout_s:g} s: {self._words()}"

    def _words(self) -> str:
        """As in `waiting for 3, 4 (3 of 5 here)`."""
        count = len(self._barrier.names)
        numbers = [int(name) for name in self._missing if name.isdigit()]
        others = sorted(name for name in self._missing if not name.isdigit())
        who = ", ".join([*filter(None, [ranges_of(numbers)]), *others])
        return f"waiting for {who} ({count - len(self._missing)} of {count} here)"
