"""The player: sends scheduled messages when they are due, obeys keys, measures its own timing."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Protocol

import msgspec

from fleet.analysis.latency_bins import binned_quantiles_s, latency_bin
from fleet.analysis.words import counted
from fleet.playback.schedule import ReplayMessage, ReplayTimeline

CLOCK_TOPIC = "replay/clock"
RATE_STEP = 0.1
LOOK_NS = 50_000_000
"""Keys are looked at at least this often, also while the player is behind."""
CHECK_NS = 1_000_000_000
"""The connection is checked at least this often."""
IDLE_NS = 5_000_000
"""What comes next is read in a gap at least this long: a chunk of the log takes some time."""
READ_AHEAD = 5000
"""Messages that are kept at most before they are due."""


class PlayerKey(Enum):
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


class PlayerInput(Protocol):
    """What the player needs of the world: a steady clock, and somebody at the keys."""

    def now_ns(self) -> int:
        """The time."""
        ...

    def wait(self, until_ns: int) -> Sequence[PlayerKey]:
        """The keys that are pressed, as soon as there are any, or none at that time."""
        ...


@dataclass
class ReplayReport:
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

    def words(self) -> str:
        """As in `120 messages in 2.000 s; timing error p50 0.05 ms, p99 0.21 ms, max 0.40 ms`."""
        told = f"{counted(self.messages, 'message')} in {self.duration_s:.3f} s"
        spread = [f"{name} {1e3 * value:.2f} ms" for name, value in self.errors_s().items()]
        return told + (f"; timing error {', '.join(spread)}" if spread else "")

    def __repr__(self) -> str:
        """How much was sent, in which time, and how late."""
        return f"<replayed {self.words()}>"

    def sent(self, message: ReplayMessage, now_ns: int, late_ns: int | None) -> None:
        """Count a message; it was sent by hand if it has no lateness."""
        if not self.messages:
            self.begun_ns = now_ns
        self.messages += 1
        self.rounds = message.round + 1
        self.payload_bytes += len(message.payload)
        self.ended_ns = now_ns
        if late_ns is not None:
            self.bins[latency_bin(late_ns)] += 1
            self.worst_ns = max(self.worst_ns, late_ns)


class Player:
    """Plays a schedule to its end; `report` tells how it went, also while it goes on.

    `put` sends a message, `check` is called now and then and raises what should end the replay,
    `tell` takes words for the user. A message that is behind time is sent at once.
    """

    def __init__(
        self,
        timeline: ReplayTimeline,
        player_input: PlayerInput,
        put: Callable[[str, bytes], None],
        *,
        clock_hz: float = 0.0,
        check: Callable[[], None] = lambda: None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.report = ReplayReport()
        self._timeline = timeline
        self._input = player_input
        self._put = put
        self._check = check
        self._tell = tell
        self._keys: deque[PlayerKey] = deque()
        self._last: ReplayMessage | None = None
        now_ns = player_input.now_ns()
        self._look_ns = self._check_ns = now_ns
        self._clock_every_ns = round(1e9 / clock_hz) if clock_hz else 0
        self._clock_ns = now_ns

    def play(self, schedule: Iterable[ReplayMessage]) -> None:
        """Send everything; ends with the schedule."""
        ahead, source = deque[ReplayMessage](), iter(schedule)
        while ahead or self._read(ahead, source):
            message = ahead.popleft()
            late_ns = self._await(message, ahead, source)
            now_ns = self._input.now_ns()
            self._put(message.topic, message.payload)
            self.report.sent(message, now_ns, late_ns)
            self._last = message

    def _read(self, ahead: deque[ReplayMessage], source: Iterator[ReplayMessage]) -> bool:
        """Read one more message; False at the end."""
        message = next(source, None)
        if message is not None:
            ahead.append(message)
        return message is not None

    def _await(
        self, message: ReplayMessage, ahead: deque[ReplayMessage], source: Iterator[ReplayMessage]
    ) -> int | None:
        """Wait until a message is due: how late it is by now; None if the user calls for it."""
        more = True
        while True:
            now_ns = self._input.now_ns()
            self._attend(message, now_ns)
            due_ns = self._timeline.due_ns(message.schedule_ns)
            while self._keys:
                if self._obey(self._keys.popleft(), message, now_ns):
                    return None
                due_ns = self._timeline.due_ns(message.schedule_ns)
            if due_ns is not None and due_ns <= now_ns:
                return now_ns - due_ns
            idle = due_ns is None or due_ns - now_ns > IDLE_NS
            if more and idle and len(ahead) < READ_AHEAD:
                more = self._read(ahead, source)
                continue
            until_ns = self._check_ns if due_ns is None else min(due_ns, self._check_ns)
            if self._clock_every_ns:
                until_ns = min(until_ns, self._clock_ns)
            self._keys.extend(self._input.wait(until_ns))
            self._look_ns = now_ns + LOOK_NS

    def _attend(self, message: ReplayMessage, now_ns: int) -> None:
        """Do what has to be done now and then: the clock, the connection, a look at the keys."""
        if self._clock_every_ns and now_ns >= self._clock_ns:
            self._put(CLOCK_TOPIC, msgspec.msgpack.encode(self._clock(message, now_ns)))
            missed = (now_ns - self._clock_ns) // self._clock_every_ns
            self._clock_ns += (missed + 1) * self._clock_every_ns
        if now_ns >= self._check_ns:
            self._check()
            self._check_ns = now_ns + CHECK_NS
        if now_ns >= self._look_ns:
            self._keys.extend(self._input.wait(now_ns))
            self._look_ns = now_ns + LOOK_NS

    def _clock(self, message: ReplayMessage, now_ns: int) -> ReplayClock:
        """The log time at which the schedule is, between the last message and the next one."""
        timeline = self._timeline
        position_ns = max(0, timeline.position_ns(now_ns))
        of = message if self._last is None or position_ns >= message.round_ns else self._last
        t_ns = of.origin_ns + position_ns - of.round_ns
        return ReplayClock(t_ns, timeline.rate, timeline.paused, of.round)

    def _obey(self, key: PlayerKey, message: ReplayMessage, now_ns: int) -> bool:
        """Do what a key says; True if that is to send the next message now."""
        timeline = self._timeline
        match key:
            case PlayerKey.PAUSE if timeline.paused:
                timeline.resume(now_ns)
                self._tell("going on")
            case PlayerKey.PAUSE:
                timeline.pause(now_ns)
                at_s = (
                    max(0, timeline.position_ns(now_ns) - message.round_ns + message.origin_ns)
                    / 1e9
                )
                self._tell(f"paused at {at_s:.3f} s")
            case PlayerKey.NEXT if timeline.paused:
                timeline.move(message.schedule_ns, now_ns)
                at_s = (message.schedule_ns - message.round_ns + message.origin_ns) / 1e9
                self._tell(f"{at_s:.3f} s  {message.topic}")
                return True
            case PlayerKey.FASTER | PlayerKey.SLOWER:
                step = 1 + RATE_STEP if key is PlayerKey.FASTER else 1 - RATE_STEP
                timeline.set_rate(timeline.rate * step, now_ns)
                self._tell(f"rate {timeline.rate:.3g}")
            case _:
                pass
        return False
