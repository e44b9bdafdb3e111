"""Outages of a realtime run: who was silent from when to when, as the simulation hears it.

Everybody is heard often: UAVs in every tick, the coordinator with its heartbeats. Who is not has no
link for a while, or no process. Neither ends a realtime run; it is put on record, and those who
come back are welcome: the same process, or a new one as its next incarnation.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from fleet.config.scenario import Scenario
from fleet.config.traffic import participants
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns, to_s
from fleet.model.words import OutageEnd
from fleet.protocol.messages import Outage

LEAST_SILENCE_NS = 400_000_000
SILENT_TICKS, SILENT_HEARTBEATS = 4, 4
"""Who is not heard for longer than so many of its messages take, and that time, is silent."""


class OutageTracker:
    """Told who is heard when; tells of outages when they are over. Times are of the run, in ns.

    `left` are those whose token has vanished from the router: their processes have ended, or are
    cut off for longer than the lease. Of tokens another thread tells.
    """

    def __init__(self, scenario: Scenario) -> None:
        uav_ns = max(LEAST_SILENCE_NS, SILENT_TICKS * scenario.tick_ns)
        heartbeats_ns = SILENT_HEARTBEATS * to_ns(scenario.coordination.heartbeat_s)
        limits_ns = {COORDINATOR: max(heartbeats_ns, uav_ns)}
        self._limits_ns = {n: limits_ns.get(n, uav_ns) for n in participants(scenario)}
        self._heard_ns = dict.fromkeys(self._limits_ns, 0)
        self.left: set[int] = set()
        self._there: set[int] = set()

    def leave(self, node: int) -> None:
        """Its token has vanished."""
        self._there.discard(node)
        self.left.add(node)

    def come(self, node: int) -> None:
        """Its token is there: the process that had it before, or a new one, which says so."""
        self._there.add(node)

    def heard(self, node: int, at_ns: int) -> Outage | None:
        """A message of a participant came: the outage that this ends, if there was one."""
        if node in self.left and node in self._there:
            self.left.discard(node)
        if at_ns - self._heard_ns[node] > self._limits_ns[node]:
            return self._tell(node, at_ns, OutageEnd.BACK)
        self._heard_ns[node] = max(at_ns, self._heard_ns[node])
        return None

    def restarted(self, node: int, at_ns: int) -> Outage:
        """Another process has come in the place of one that has left."""
        self.left.discard(node)
        return self._tell(node, at_ns, OutageEnd.RESTARTED)

    def excuse(self, nodes: Iterable[int], at_ns: int) -> None:
        """The fault plan has stopped or killed these: they are not expected to be heard."""
        for node in nodes:
            self._heard_ns[node] = at_ns

    def silent(self, at_ns: int) -> list[int]:
        """Who is silent at a time."""
        heard_ns = self._heard_ns
        return [n for n, limit in self._limits_ns.items() if at_ns - heard_ns[n] > limit]

    def absent(self, at_ns: int) -> set[int]:
        """In whose place another process may come."""
        return {*self.silent(at_ns), *self.left}

    def finish(self, at_ns: int) -> list[Outage]:
        """The run is over: the outages that are not."""
        return [self._tell(node, at_ns, OutageEnd.LOST) for node in sorted(self.absent(at_ns))]

    def _tell(self, node: int, at_ns: int, why: OutageEnd) -> Outage:
        since_ns = max(0, self._heard_ns[node])
        self._heard_ns[node] = at_ns
        return Outage(max(at_ns, since_ns), node, since_ns, why)


def outages_json(outages: Sequence[Outage]) -> list[dict[str, Any]]:
    """Who was not heard from when to when, in s, and how that ended."""
    return [
        {"id": o.id, "since_s": to_s(o.since_ns), "until_s": to_s(o.t_ns), "end": o.end}
        for o in outages
    ]
