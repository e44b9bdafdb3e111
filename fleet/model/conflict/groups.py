"""Conflict groups: the connected components of the graph of conflicts, with some inertia."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from fleet.model.conflict.tracks import StateReport
from fleet.model.types import Pair


class Grouping:
    """Conflict groups with some inertia: a pair stays for a while after it was last at risk.

    Without it a group would come and go with every lost broadcast, each time in a new term.
    """

    def __init__(self, hold_ns: int) -> None:
        self._hold_ns = hold_ns
        self._seen_ns: dict[Pair, int] = {}

    def groups(self, pairs: Iterable[Pair], now_ns: int) -> list[tuple[int, ...]]:
        """The groups, given the pairs at risk now."""
        self._seen_ns.update(dict.fromkeys(pairs, now_ns))
        oldest = now_ns - self._hold_ns
        self._seen_ns = {p: t for p, t in self._seen_ns.items() if t >= oldest}
        return connected(sorted(self._seen_ns))


def commanded(reports: Sequence[StateReport]) -> list[Pair]:
    """A UAV under command stays with its issuer until it is told to resume its plan."""
    present = {r.id for r in reports}
    pairs = [(r.id, r.command_id.issuer) for r in reports if r.manoeuvre and r.command_id]
    return [(min(p), max(p)) for p in pairs if p[1] in present and p[0] != p[1]]


def connected(pairs: Iterable[Pair]) -> list[tuple[int, ...]]:
    """Connected components of the graph with these edges, each sorted, in order of lowest ID."""
    leader: dict[int, int] = {}

    def find(node: int) -> int:
        leader.setdefault(node, node)
        while leader[node] != node:
            leader[node] = leader[leader[node]]
            node = leader[node]
        return node

    for a, b in pairs:
        low, high = sorted((find(a), find(b)))
        leader[high] = low
    members: dict[int, list[int]] = {}
    for node in sorted(leader):
        members.setdefault(find(node), []).append(node)
    return [tuple(members[root]) for root in sorted(members)]
