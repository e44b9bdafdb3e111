"""Attendance: in a realtime run, whether what comes in a participant's name can be its own.

Lockstep has an account of every tick. In realtime a process that was killed never gives one, so
its messages are held against what is known of it. By the simulation's own word it was stopped or
dead from then to then; and its link is reliable and keeps the order, so that what it sent comes
without a gap, class by class, and its times do not go back. The simulation and `fleet check` go by
the same.
"""

from __future__ import annotations

from collections import Counter, defaultdict

from msgspec import Struct, field

from fleet.model.conflict.contact import INCARNATION
from fleet.model.words import ClockState, OutageEnd
from fleet.protocol.messages import Clock, Done, Outage, Truth

AWAY, OUT_OF_ORDER = "away", "out of order"
"""Why a message is not its issuer's own."""

LAST_WORDS_NS = 2_000_000_000
"""How long after a process has sent its last message that may still be on its way."""

RESUME_NS = 5_000_000_000
"""So long after an outage messages may be missing among those that come."""

_NEVER_NS = 2**63


class Absence(Struct, gc=False):
    """A process cannot have sent anything after `since_ns`, before `until_ns`."""

    since_ns: int
    until_ns: int = _NEVER_NS


class Incarnation(Struct):
    """What a process has sent between two starts: the next number and last time of each class.

    After an outage (`cut`) messages may be missing: for a while (`resuming_ns`), and before the
    first one of each class that comes (`resumed`).
    """

    number: int = 0
    begun_ns: int = 0
    ended_ns: int = _NEVER_NS
    following: dict[str, int] = field(default_factory=dict)
    latest_ns: dict[str, int] = field(default_factory=dict)
    cut: bool = False
    resuming_ns: int = 0
    resumed: set[str] = field(default_factory=set)
    missing: int = 0

    def excuses(self, kind: str, arrived_ns: int) -> bool:
        """Whether messages of a class may be missing before one that came then."""
        return self.cut and (arrived_ns <= self.resuming_ns or kind not in self.resumed)


class Attendance:
    """Who was there when, and how far each has counted. Times are simulated ones, in ns."""

    def __init__(self, tick_ns: int) -> None:
        self._tick_ns = tick_ns
        self._held: frozenset[int] = frozenset()
        self._down: frozenset[int] = frozenset()
        self._absences: defaultdict[int, list[Absence]] = defaultdict(list)
        self._incarnations: defaultdict[int, list[Incarnation]] = defaultdict(
            lambda: [Incarnation()]
        )

    def hear(self, clock: Clock, said_ns: int) -> None:
        """The simulation says, when it has carried it out, who is stopped or dead from a tick on.

        Who is to go on or to start again does so after that tick has begun.
        """
        if clock.state == ClockState.EPOCH:
            return  # said to one who has been started again; it lists nobody
        held, down = frozenset(clock.held), frozenset(clock.down)
        for node in self._held - held - down:
            self._absences[node][-1].until_ns = clock.t_ns
        for node in self._down - down:
            self._absences[node][-1].until_ns = clock.t_ns
            self._incarnations[node].append(Incarnation(len(self._incarnations[node]), clock.t_ns))
        for node in ((held | down) - self._held - self._down) | (self._down & held):
            self._absences[node].append(Absence(said_ns))
        for node in down - self._down:
            self._incarnations[node][-1].ended_ns = self._absences[node][-1].since_ns
        self._held, self._down = held, down

    def outage(self, outage: Outage) -> None:
        """A participant was not heard for a while; what it sent meanwhile may be missing."""
        incarnation = self._incarnations[outage.id][-1]
        incarnation.cut, incarnation.resumed = True, set()
        incarnation.resuming_ns = outage.t_ns + RESUME_NS
        if outage.end == OutageEnd.RESTARTED:
            incarnation.ended_ns = outage.t_ns
            number = len(self._incarnations[outage.id])
            self._incarnations[outage.id].append(Incarnation(number, outage.since_ns))

    def was_cut(self, node: int, number: int) -> bool:
        """Whether messages of an incarnation may be missing after an outage."""
        incarnations = self._incarnations[node]
        return number < len(incarnations) and incarnations[number].cut

    @property
    def missing(self) -> dict[int, int]:
        """How many messages of whom are missing after outages, as far as their numbers tell."""
        found = Counter[int]()
        for node, known in self._incarnations.items():
            for incarnation in known:
                found[node] += incarnation.missing
        return {node: count for node, count in sorted(found.items()) if count}

    def incarnation_of(self, node: int, kind: str, seq: int, t_ns: int) -> int:
        """In which incarnation a message was sent; true states and reports do not number it."""
        if kind not in (Truth.kind, Done.kind):
            return seq // INCARNATION
        return next((e.number for e in reversed(self._incarnations[node]) if e.begun_ns <= t_ns), 0)

    def refusal(self, node: int, kind: str, seq: int, t_ns: int, arrived_ns: int) -> str:
        """Why a message cannot be its issuer's own; empty if it can, and then it counts."""
        incarnations, number = self._incarnations[node], self.incarnation_of(node, kind, seq, t_ns)
        if self._silent(node, t_ns, arrived_ns):
            return AWAY
        if number >= len(incarnations):
            return OUT_OF_ORDER
        incarnation = incarnations[number]
        if not incarnation.begun_ns <= t_ns <= incarnation.ended_ns:
            return AWAY
        if kind == Done.kind:
            return ""
        return "" if self._follows(incarnation, kind, seq, t_ns, arrived_ns) else OUT_OF_ORDER

    def _silent(self, node: int, t_ns: int, arrived_ns: int) -> bool:
        """Whether it came when nothing could come, or only what was sent before."""
        absences = self._absences[node]
        away = next((a for a in reversed(absences) if a.since_ns < arrived_ns), None)
        if away is None or arrived_ns >= away.until_ns:
            return False
        return t_ns > away.since_ns or arrived_ns > away.since_ns + LAST_WORDS_NS

    def _follows(
        self, incarnation: Incarnation, kind: str, seq: int, t_ns: int, arrived_ns: int
    ) -> bool:
        """Whether it follows the last one of its class; only steps, and so true states, miss."""
        counted = kind != Truth.kind
        due = incarnation.following.get(kind, incarnation.number * INCARNATION if counted else 0)
        right = seq == due if counted else seq >= due and t_ns == seq * self._tick_ns
        if not right and counted and seq > due and incarnation.excuses(kind, arrived_ns):
            right, incarnation.missing = True, incarnation.missing + seq - due
        if incarnation.cut:
            incarnation.resumed.add(kind)
        right = right and t_ns >= incarnation.latest_ns.get(kind, 0)
        incarnation.following[kind], incarnation.latest_ns[kind] = seq + 1, t_ns
        return right
