"""The player: sends the cues of a tape when they are due, obeys keys, measures its own timing."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Protocol

import msgspec

from fleet.analysis.tally import LATENCY_BIN_NS, binned_quantiles_s
from fleet.replay.tape import Cue, Timeline

CLOCK_TOPIC = "replay/clock"
RATE_STEP = 0.1
LOOK_NS = 50_000_000
"""Keys are looked at at least this often, also while the player is behind."""
CHECK_NS = 1_000_000_000
"""The connection is checked at least this often."""
IDLE_NS = 5_000_000
"""What comes next is read in a gap at least this long: a chunk of the log takes some time."""
AHEAD = 5000
"""Cues that are kept at most before they are due."""


class Key(Enum):
    """What the user can do while a log is replayed."""

    PAUSE = auto()
    NEXT = auto()
    FASTER = auto()
    SLOWER = auto()


class ReplayClock(msgspec.Struct, frozen=True):
    """The replay's clock: log time in ns, log seconds a second, whether it stands, round from 0."""

    t_ns: int
    rate: float
    paused: bool
    round: int


class Desk(Protocol):
    """What the player needs of the world: a steady clock, and somebody at the keys."""

    def now_ns(self) -> int:
        """The time."""
        ...

    def wait(self, until_ns: int) -> Sequence[Key]:
        """The keys that are pressed, as soon as there are any, or none at that time."""
        ...


@dataclass
class Report:
    """What was replayed so far. Errors are actual minus scheduled times, in bins."""

    messages: int = 0
    payload_bytes: int = 0
    rounds: int = 0
    begun_ns: int = 0
    ended_ns: int = 0
    bins: Counter[int] = field(default_factory=Counter)
    worst_ns: int = 0

    @property
    def duration_s(self) -> float:
        """From the first message to the last, pauses included."""
        return (self.ended_ns - self.begun_ns) / 1e9

    def errors_s(self) -> dict[str, float]:
        """Median, 99th percentile and maximum; empty if no message had a scheduled time."""
        found = binned_quantiles_s(self.bins)
        return {**found, "max": self.worst_ns / 1e9} if found else {}

    def sent(self, cue: Cue, now_ns: int, late_ns: int | None) -> None:
        """Count a message; it was sent by hand if it has no lateness."""
        if not self.messages:
            self.begun_ns = now_ns
        self.messages += 1
        self.rounds = cue.round + 1
        self.payload_bytes += len(cue.payload)
        self.ended_ns = now_ns
        if late_ns is not None:
            self.bins[late_ns // LATENCY_BIN_NS] += 1
            self.worst_ns = max(self.worst_ns, late_ns)


class Player:
    """Plays a tape to its end; `report` tells how it went, also while it goes on.

    `put` sends a message, `check` is called now and then and raises what should end the replay,
    `tell` takes words for the user. A message that is behind time is sent at once.
    """

    def __init__(
        self,
        timeline: Timeline,
        desk: Desk,
        put: Callable[[str, bytes], None],
        *,
        clock_hz: float = 0.0,
        check: Callable[[], None] = lambda: None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.report = Report()
        self._timeline = timeline
        self._desk = desk
        self._put = put
        self._check = check
        self._tell = tell
        self._keys: deque[Key] = deque()
        self._last: Cue | None = None
        now_ns = desk.now_ns()
        self._look_ns = self._check_ns = now_ns
        self._clock_every_ns = round(1e9 / clock_hz) if clock_hz else 0
        self._clock_ns = now_ns

    def play(self, tape: Iterable[Cue]) -> None:
        """Send everything; ends with the tape."""
        ahead, source = deque[Cue](), iter(tape)
        while ahead or self._read(ahead, source):
            cue = ahead.popleft()
            late_ns = self._await(cue, ahead, source)
            now_ns = self._desk.now_ns()
            self._put(cue.topic, cue.payload)
            self.report.sent(cue, now_ns, late_ns)
            self._last = cue

    def _read(self, ahead: deque[Cue], source: Iterator[Cue]) -> bool:
        """Read one more cue; False at the end."""
        cue = next(source, None)
        if cue is not None:
            ahead.append(cue)
        return cue is not None

    def _await(self, cue: Cue, ahead: deque[Cue], source: Iterator[Cue]) -> int | None:
        """Wait until a cue is due: how late it is by now; None if the user calls for it."""
        more = True
        while True:
            now_ns = self._desk.now_ns()
            self._attend(cue, now_ns)
            due_ns = self._timeline.due_ns(cue.tape_ns)
            while self._keys:
                if self._obey(self._keys.popleft(), cue, now_ns):
                    return None
                due_ns = self._timeline.due_ns(cue.tape_ns)
            if due_ns is not None and due_ns <= now_ns:
                return now_ns - due_ns
            idle = due_ns is None or due_ns - now_ns > IDLE_NS
            if more and idle and len(ahead) < AHEAD:
                more = self._read(ahead, source)
                continue
            until_ns = self._check_ns if due_ns is None else min(due_ns, self._check_ns)
            if self._clock_every_ns:
                until_ns = min(until_ns, self._clock_ns)
            self._keys.extend(self._desk.wait(until_ns))
            self._look_ns = now_ns + LOOK_NS

    def _attend(self, cue: Cue, now_ns: int) -> None:
        """Do what has to be done now and then: the clock, the connection, a look at the keys."""
        if self._clock_every_ns and now_ns >= self._clock_ns:
            self._put(CLOCK_TOPIC, msgspec.msgpack.encode(self._clock(cue, now_ns)))
            missed = (now_ns - self._clock_ns) // self._clock_every_ns
            self._clock_ns += (missed + 1) * self._clock_every_ns
        if now_ns >= self._check_ns:
            self._check()
            self._check_ns = now_ns + CHECK_NS
        if now_ns >= self._look_ns:
            self._keys.extend(self._desk.wait(now_ns))
            self._look_ns = now_ns + LOOK_NS

    def _clock(self, cue: Cue, now_ns: int) -> ReplayClock:
        """The log time at which the tape is, between the last cue and the next one."""
        timeline = self._timeline
        position_ns = max(0, timeline.position_ns(now_ns))
        of = cue if self._last is None or position_ns >= cue.round_ns else self._last
        t_ns = of.origin_ns + position_ns - of.round_ns
        return ReplayClock(t_ns, timeline.rate, timeline.paused, of.round)

    def _obey(self, key: Key, cue: Cue, now_ns: int) -> bool:
        """Do what a key says; True if that is to send the next message now."""
        timeline = self._timeline
        match key:
            case Key.PAUSE if timeline.paused:
                timeline.resume(now_ns)
                self._tell("going on")
            case Key.PAUSE:
                timeline.pause(now_ns)
                at_s = max(0, timeline.position_ns(now_ns) - cue.round_ns + cue.origin_ns) / 1e9
                self._tell(f"paused at {at_s:.3f} s")
            case Key.NEXT if timeline.paused:
                timeline.move(cue.tape_ns, now_ns)
                at_s = (cue.tape_ns - cue.round_ns + cue.origin_ns) / 1e9
                self._tell(f"{at_s:.3f} s  {cue.topic}")
                return True
            case Key.FASTER | Key.SLOWER:
                step = 1 + RATE_STEP if key is Key.FASTER else 1 - RATE_STEP
                timeline.set_rate(timeline.rate * step, now_ns)
                self._tell(f"rate {timeline.rate:.3g}")
            case _:
                pass
        return False
