"""What a participant is about, told on request: so that a run that stands still explains it."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Mapping

import msgspec

from fleet.node.intake import Intake
from fleet.protocol.topics import progress_of
from fleet.transport.zenoh_bus import Bus

FRAMES = 4


class ProgressReport(msgspec.Struct, frozen=True):
    """Tick, what is done in it, what the manifest lists and has not come, and where in the code."""

    tick: int
    doing: str
    lacking: dict[str, tuple[tuple[int, int], ...]]
    where: tuple[str, ...]
    lacked_room: int = 0
    """Messages that were dropped because too many waited."""
    unix_ns: int = 0
    """When this was told, by the wall clock of the participant."""


class ParticipantProgress:
    """Kept by the loop of a participant, told by a thread of the bus: also while the loop waits."""

    def __init__(self, bus: Bus) -> None:
        self.tick = -1
        self.doing = "starting"
        self.intakes: Callable[[], Mapping[str, Intake]] = dict
        self.lacked_room: Callable[[], int] = int
        self._thread = threading.get_ident()
        self._now_unix_ns = bus.now_unix_ns
        bus.answer(progress_of(bus.name), lambda _, reply: reply(self.told()))

    def at(self, tick: int, doing: str) -> None:
        """The loop goes on to this."""
        self.tick, self.doing = tick, doing

    def told(self) -> bytes:
        """As an answer."""
        lacking = {s: tuple(sorted(i.lacking)) for s, i in self.intakes().items() if i.lacking}
        frame = sys._current_frames().get(self._thread)
        stack = traceback.extract_stack(frame)[-FRAMES:] if frame else []
        where = tuple(f"{f.filename}:{f.lineno} {f.name}" for f in stack)
        now_ns = self._now_unix_ns()
        report = ProgressReport(self.tick, self.doing, lacking, where, self.lacked_room(), now_ns)
        return msgspec.json.encode(report)


def read_progress(answer: bytes) -> ProgressReport | None:
    """What an answer says, if it is one."""
    try:
        return msgspec.json.decode(answer, type=ProgressReport)
    except (ValueError, RecursionError):
        return None
