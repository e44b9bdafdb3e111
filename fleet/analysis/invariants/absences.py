"""Who was away when: stopped, dead or not heard, as the simulation tells it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from fleet.model.units import NS_PER_S
from fleet.model.words import OutageEnd
from fleet.protocol.attendance import RESUME_NS
from fleet.protocol.messages import Clock, Outage

SLACK_NS = NS_PER_S
"""Realtime: what happens so near the beginning or end of an incarnation or of a cut log may be
missing.

Of an incarnation it is time in which the process runs: one that is stopped begins and receives
nothing.
"""

AwaySpans = list[tuple[int, int | None]]
"""From when to when something lasted, in order of time; None: to the end."""


class Absent(NamedTuple):
    """Who does not run from some tick on, as the simulation tells: stopped, and killed."""

    held: tuple[int, ...] = ()
    down: tuple[int, ...] = ()


class Absences:
    """When each process did not run, or was not heard, and how long one was the same process.

    `end_ns` is the end of what is on record.
    """

    def __init__(self, nodes: Sequence[int], *, realtime: bool) -> None:
        self.end_ns = 0
        self.grants: dict[int, Absent] = {}
        self.downs: dict[int, AwaySpans] = {n: [] for n in nodes}
        self.stops: dict[int, AwaySpans] = {n: [] for n in nodes}
        self.outages: list[Outage] = []
        self._realtime = realtime
        self._heard_by: dict[tuple[int, int], int] = {}

    def tell(self, clock: Clock) -> None:
        """The simulation tells who is away from a tick on."""
        self.grants[clock.t_ns] = Absent(clock.held, clock.down)
        _note_away(self.downs, clock.t_ns, clock.down)
        _note_away(self.stops, clock.t_ns, clock.held)

    def tell_outage(self, outage: Outage) -> None:
        """Nothing was heard of a participant; another process in its place begins anew."""
        if outage.id in self.downs:
            self.outages.append(outage)
            if outage.end == OutageEnd.RESTARTED:
                self.downs[outage.id].append((outage.since_ns, outage.t_ns))

    def incarnation_of(self, node: int, t_ns: int) -> tuple[int, int | None]:
        """When the incarnation of a process at a time began, and when it ended, if it did.

        A process that is down at that time has ended before it began.
        """
        begun_ns = 0
        for killed_ns, restarted_ns in self.downs[node]:
            if t_ns < killed_ns:
                return begun_ns, killed_ns
            if restarted_ns is None or t_ns < restarted_ns:
                return t_ns, t_ns
            begun_ns = restarted_ns
        return begun_ns, None

    def settled_after_ns(self, node: int, t_ns: int) -> int:
        """When a process has done what was due at a time: in realtime after it ran for a while.

        What is sent to one that is stopped reaches it only once it goes on, and if it is stopped
        again and again it takes that much longer.
        """
        if not self._realtime:
            return t_ns
        settled_ns = t_ns + SLACK_NS
        for stopped_ns, resumed_ns in self.stops[node]:
            if stopped_ns >= settled_ns:
                break
            until_ns = self.end_ns if resumed_ns is None else resumed_ns
            settled_ns += max(0, until_ns - max(stopped_ns, t_ns))
        return settled_ns

    def heard_by_ns(self, node: int, said_ns: int) -> int:
        """When a process has heard what the simulation said: in realtime after any outage of it."""
        known = self._heard_by.get((node, said_ns))
        if known is not None:
            return known
        heard_ns = self.settled_after_ns(node, said_ns)
        for outage in sorted(self.outages, key=lambda o: o.since_ns):
            over_ns = outage.t_ns + RESUME_NS
            if outage.id == node and outage.since_ns - SLACK_NS <= heard_ns and said_ns <= over_ns:
                heard_ns = max(heard_ns, over_ns)
        self._heard_by[node, said_ns] = heard_ns
        return heard_ns

    def in_outage(self, *nodes: int, since_ns: int, until_ns: int) -> bool:
        """Whether a link of one of these was silent in between, or had just been."""
        return any(
            outage.id in nodes
            and outage.since_ns - SLACK_NS <= until_ns
            and since_ns <= outage.t_ns + RESUME_NS
            for outage in self.outages
        )


def _note_away(known: dict[int, AwaySpans], t_ns: int, away: tuple[int, ...]) -> None:
    """Add to the spans of everybody who is away from a time on, and who no longer is."""
    for node, spans in known.items():
        gone = bool(spans) and spans[-1][1] is None
        if node in away and not gone:
            spans.append((t_ns, None))
        elif node not in away and gone:
            spans[-1] = (spans[-1][0], t_ns)
