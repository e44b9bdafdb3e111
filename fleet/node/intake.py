"""The intake of a lockstep participant: it takes what the clock's manifest lists, and nothing else.

Other participants may be a tick ahead, so what comes early waits for the manifest that lists it.
What no manifest lists, since no participant says to have sent it, is never used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from fleet.node.gate import Gate, RefusedError
from fleet.protocol.messages import Message
from fleet.protocol.sample import Sample

MOST_EARLY = 16_384
"""So many messages of a suffix wait for a manifest; what comes then is refused."""

Listed = tuple[int, int]
"""A message in the manifest: its issuer and its sequence number."""
Taken = tuple[Sample, Message]


class Intake:
    """What has arrived on the topics of one suffix, and has not been taken yet.

    `lacking` is what is waited for: listed, and not arrived. `lacked_room` counts what came when
    there was no room for more.
    """

    def __init__(self, gate: Gate) -> None:
        self._gate = gate
        self._waiting: dict[Listed, Taken] = {}
        self._last: dict[int, int] = {}
        self.lacking: set[Listed] = set()
        self.lacked_room = 0

    def offer(self, arrival: Sample) -> Listed | None:
        """Let what arrived wait, if it is a message that can still be listed."""
        try:
            message = self._gate.admit(arrival)
        except RefusedError:
            return None
        key = message.id, message.seq
        if key in self._waiting or message.seq <= self._last.get(message.id, -1):
            return None
        if len(self._waiting) >= MOST_EARLY and key not in self.lacking:
            self.lacked_room += 1
            return None
        self._waiting[key] = arrival, message
        return key

    def take(self, listed: Iterable[Listed], more: Callable[[], Sample]) -> list[Taken]:
        """All that is listed; `more` waits for what arrives next."""
        wanted = list(dict.fromkeys(listed))
        self.lacking = set(wanted) - self._waiting.keys()
        while self.lacking:
            key = self.offer(more())
            if key is not None:
                self.lacking.discard(key)
        taken = [self._waiting.pop(key) for key in wanted]
        self._pass(wanted)
        return taken

    def _pass(self, taken: list[Listed]) -> None:
        """What comes with lower numbers from now on is too late for any manifest."""
        self._last.update(taken)
        if self._waiting:
            last = self._last
            self._waiting = {k: v for k, v in self._waiting.items() if k[1] > last.get(k[0], -1)}
