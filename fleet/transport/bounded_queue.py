"""What waits to be read in realtime: no more than so many messages and bytes.

Nothing is dropped in silence: whoever reads on after something had no room is told so.
"""

from __future__ import annotations

import queue
import threading

from fleet.errors import FleetStoppedError
from fleet.protocol.sample import Sample

MOST_WAITING = 100_000
"""A participant among 1,000 UAVs hears 6,000 messages a second."""
MOST_WAITING_BYTES = 64 << 20


class BoundedQueue:
    """First in, first out, from threads of the bus to the loop of a process.

    `lacked_room` counts what came when there was no room.
    """

    def __init__(self, most: int = MOST_WAITING, most_bytes: int = MOST_WAITING_BYTES) -> None:
        self._queue: queue.SimpleQueue[Sample] = queue.SimpleQueue()
        self._most, self._most_bytes = most, most_bytes
        self._waiting_bytes = 0
        self._lock = threading.Lock()
        self.lacked_room = 0

    def put(self, sample: Sample) -> None:
        """Let a message wait, if there is room for it."""
        size = len(sample.payload)
        with self._lock:
            if self._queue.qsize() >= self._most or self._waiting_bytes + size > self._most_bytes:
                self.lacked_room += 1
                return
            self._waiting_bytes += size
        self._queue.put(sample)

    def get(self, timeout_s: float) -> Sample | None:
        """The next one; None if there is none in time.

        Raises:
            FleetStoppedError: something had no room, so that this process cannot know all.

        """
        if self.lacked_room:
            raise FleetStoppedError(
                f"more comes than can be read: no room for {self.lacked_room} messages behind "
                f"{self._queue.qsize()}; somebody floods the bus, or this machine is too slow"
            )
        try:
            sample = self._queue.get(block=timeout_s > 0, timeout=max(timeout_s, 0.0))
        except queue.Empty:
            return None
        with self._lock:
            self._waiting_bytes -= len(sample.payload)
        return sample
