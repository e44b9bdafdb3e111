"""What is replayed when: the schedule of a log, and its position at any wall time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from fleet.errors import LogError
from fleet.log.reader import Record
from fleet.playback.topics import Selection

MIN_RATE, MAX_RATE = 1e-3, 1e6


@dataclass(frozen=True, slots=True)
class Window:
    """The part of a log that is replayed: from `offset_ns` after its first message, so long.

    Both ends belong to it. A length of None: to the end.
    """

    offset_ns: int = 0
    length_ns: int | None = None


@dataclass(frozen=True, slots=True)
class ReplayMessage:
    """A message to send when the schedule has come to `schedule_ns`.

    Its round, counted from 0, began at `round_ns`; the log time was `origin_ns` there.
    """

    schedule_ns: int
    round_ns: int
    origin_ns: int
    round: int
    topic: str
    payload: bytes


def replay_messages(
    log: Callable[[], Iterable[Record]], window: Window, selection: Selection, *, loop: bool = False
) -> Iterator[ReplayMessage]:
    """The messages of a log in its order; with `loop` again and again, one round after the other.

    A message is never due before the one before it in the log, even if its log time says so: what a
    realtime run adds afterwards has an earlier time. A round lasts until the last message in
    the window, selected or not, so that a loop keeps its period.

    Raises:
        LogError: there is nothing to replay, or nothing that could be repeated.

    """
    round_ns = 0
    for number in itertools.count():
        one = _Round(window, selection, round_ns, number)
        yield from one.messages(log())
        if not one.sent:
            raise LogError(f"nothing to replay: {one.why()}")
        if not loop:
            return
        if one.length_ns <= 0:
            raise LogError("what is to be replayed in a loop lasts 0 s; choose more of the log")
        round_ns += one.length_ns


class _Round:
    """One pass over the log."""

    def __init__(self, window: Window, selection: Selection, round_ns: int, number: int) -> None:
        self._window = window
        self._selection = selection
        self._round_ns = round_ns
        self._number = number
        self._lasted_ns = 0
        self._seen = False
        self.sent = 0
        self.length_ns = 0

    def messages(self, records: Iterable[Record]) -> Iterator[ReplayMessage]:
        """Its messages."""
        offset_ns, limit_ns = self._window.offset_ns, self._window.length_ns
        first_ns = latest_ns = 0
        for record in records:
            if not self._seen:
                self._seen = True
                first_ns = latest_ns = record.log_ns
            latest_ns = max(latest_ns, record.log_ns)
            self._lasted_ns = latest_ns - first_ns
            at_ns = self._lasted_ns - offset_ns
            if at_ns < 0:
                continue
            if limit_ns is not None and at_ns > limit_ns:
                return
            self.length_ns = at_ns
            name = self._selection.name(record.topic)
            if name is not None:
                self.sent += 1
                yield ReplayMessage(
                    self._round_ns + at_ns,
                    self._round_ns,
                    first_ns + offset_ns,
                    self._number,
                    name,
                    record.payload,
                )

    def why(self) -> str:
        """Why there was nothing."""
        if not self._seen:
            return "the log has no messages"
        if self._lasted_ns < self._window.offset_ns:
            return f"the log lasts {self._lasted_ns / 1e9:g} s; choose a smaller --start-offset"
        return "no message in this part of the log is of the topics chosen"


class ReplayTimeline:
    """Where the schedule is at any wall time: at 0 at `begin_ns`, then at a rate, or paused.

    Wall times are of any steady clock, in ns.
    """

    def __init__(self, begin_ns: int, rate: float = 1.0, *, paused: bool = False) -> None:
        self.rate = rate
        self.paused = paused
        self._wall_ns = begin_ns
        self._schedule_ns = 0

    def position_ns(self, now_ns: int) -> int:
        """Where the schedule is; negative before the beginning."""
        if self.paused:
            return self._schedule_ns
        return self._schedule_ns + math.floor((now_ns - self._wall_ns) * self.rate)

    def due_ns(self, schedule_ns: int) -> int | None:
        """When the schedule will be there; None while it stands."""
        if self.paused:
            return None
        return self._wall_ns + math.ceil((schedule_ns - self._schedule_ns) / self.rate)

    def set_rate(self, rate: float, now_ns: int) -> None:
        """Go on at another rate from here; kept within bounds."""
        self.move(self.position_ns(now_ns), now_ns)
        self.rate = min(max(rate, MIN_RATE), MAX_RATE)

    def pause(self, now_ns: int) -> None:
        """Stop here."""
        self.move(self.position_ns(now_ns), now_ns)
        self.paused = True

    def resume(self, now_ns: int) -> None:
        """Go on from here."""
        self.move(self.position_ns(now_ns), now_ns)
        self.paused = False

    def move(self, schedule_ns: int, now_ns: int) -> None:
        """Be there now."""
        self._schedule_ns, self._wall_ns = schedule_ns, now_ns
