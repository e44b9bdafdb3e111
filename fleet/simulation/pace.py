"""How fast a lockstep run goes: as fast as it can, or held to a multiple of real time; or not."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable

import msgspec
from msgspec import Struct

from fleet.protocol.topics import PACE
from fleet.transport.zenoh_bus import Bus

NAP_S = 0.02
"""So long nobody is listened to while it waits."""
FASTEST_PACE = 1000.0
MOST_PACE_REQUESTS = 64
"""So many requests wait for the next tick; others are answered at once that there is no room."""


class PaceRequest(Struct, frozen=True):
    """What is to change: None leaves it. `steps` are ticks to go while it is paused."""

    paused: bool | None = None
    speed: float | None = None
    steps: int = 0


class Pace:
    """Holds simulated time to `speed` times the wall clock's; 0: as fast as it goes."""

    def __init__(self, speed: float = 0.0) -> None:
        self.speed, self.paused = speed, False
        self._steps = 0
        self._from: tuple[float, int] | None = None
        self.lacked_room = 0
        self._asked: queue.SimpleQueue[tuple[bytes, Callable[[bytes], None]]] = queue.SimpleQueue()

    def listen(self, bus: Bus) -> None:
        """Let the operator change it from now on."""
        bus.answer(PACE, self._take)

    def _take(self, payload: bytes, reply: Callable[[bytes], None]) -> None:
        """Let a request wait, if there is room."""
        if self._asked.qsize() < MOST_PACE_REQUESTS:
            self._asked.put((payload, reply))
        else:
            self.lacked_room += 1
            reply(f"{MOST_PACE_REQUESTS} requests wait; ask again".encode())

    def due(self, now_ns: int) -> bool:
        """Whether the tick of that time may begin by now; naps if not."""
        self._hear()
        if self.paused and not self._steps:
            self._from = None
            time.sleep(NAP_S)
            return False
        if self._steps:
            self._steps -= 1
            self._from = None
            return True
        if self.speed <= 0.0:
            return True
        if self._from is None:
            self._from = time.monotonic(), now_ns
        begun_s, from_ns = self._from
        left_s = begun_s + (now_ns - from_ns) / 1e9 / self.speed - time.monotonic()
        time.sleep(max(0.0, min(left_s, NAP_S)))
        return left_s <= NAP_S

    def _hear(self) -> None:
        while not self._asked.empty():
            payload, reply = self._asked.get()
            problem = self._changed(payload)
            reply(problem.encode())

    def _changed(self, payload: bytes) -> str:
        """Change what a request says; what is wrong with it, or nothing."""
        try:
            wanted = msgspec.json.decode(payload, type=PaceRequest)
        except (ValueError, RecursionError) as error:
            return f"no request for a pace: {error}"
        if wanted.speed is not None and not 0.0 <= wanted.speed <= FASTEST_PACE:
            return f"a speed of {wanted.speed:g}: from 0 (as fast as it goes) to {FASTEST_PACE:g}"
        if not 0 <= wanted.steps <= FASTEST_PACE:
            return f"{wanted.steps} ticks: from 0 to {FASTEST_PACE:g}"
        if wanted.speed is not None:
            self.speed, self._from = wanted.speed, None
        if wanted.paused is not None:
            self.paused, self._steps = wanted.paused, 0
        self._steps += wanted.steps if self.paused else 0
        return ""
