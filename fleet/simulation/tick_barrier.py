"""The tick barrier: whom the simulation waits for, and what has come so far."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

from fleet.protocol.topics import issuer_name
from fleet.simulation.listener import OwnMessages
from fleet.transport.interface import ReceivedMessage


class TickBarrier:
    """Whom the simulation waits for, and has heard of, in a tick; `busy` while it waits.

    `items` is what has come of the tick in work; `joining` until everybody has been there once.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = frozenset(names)
        self.words = OwnMessages()
        self.waiting: set[str] = set(names)
        self.items: list[ReceivedMessage] = []
        self.moved_s = time.monotonic()
        self.busy = True
        self.joining = True

    def expect(self, numbers: Iterable[int]) -> None:
        """These are awaited from now on."""
        self.waiting = {issuer_name(n) for n in numbers}
        self.moved_s = time.monotonic()
        self.busy = True

    def moved(self) -> None:
        """Something has happened: the run does not stand still."""
        self.moved_s = time.monotonic()

    def heard(self, name: str) -> None:
        """One of them has reported."""
        self.waiting.discard(name)
