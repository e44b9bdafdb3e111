"""Conflict groups: who is in conflict with whom, and the connected components of that graph."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fleet.model.conflict.risk import Required, first_overlap_s
from fleet.model.conflict.tracks import StateReport, ages_s, fastest_mps, states_at
from fleet.model.types import Array, Pair
from fleet.model.vehicle.fleet_models import FleetModels


@dataclass(frozen=True, slots=True)
class Outlook:
    """How far ahead, how finely and with what separation conflicts are sought."""

    models: FleetModels
    times_s: Array
    required: Required

    @property
    def horizon_s(self) -> float:
        """T_s."""
        return float(self.times_s[-1])


def conflicts(reports: Sequence[StateReport], now_ns: int, outlook: Outlook) -> dict[Pair, float]:
    """Pairs (lower ID first) at risk within the horizon from `now_ns`, and how soon, in s.

    A pair is at risk when what either flies, or what its guidance would fly if released, overlaps
    with either of the other's: a group lasts until its manoeuvres can be ended safely.
    """
    first, second = _within_reach(reports, now_ns, outlook)
    if not len(first):
        return {}
    near = np.zeros(len(reports), dtype=np.bool_)
    near[first] = near[second] = True
    place = np.cumsum(near) - 1
    one, two = place[first], place[second]
    picked = [r for r, n in zip(reports, near, strict=True) if n]
    flown = trajectories(picked, now_ns, outlook)
    relative = [flown[one] - flown[two]]
    if any(r.manoeuvre for r in picked):
        states = states_at(picked, now_ns, outlook.models)
        ages = ages_s(picked, now_ns).tolist()
        wanted = [r.guidance.after(age) for r, age in zip(picked, ages, strict=True)]
        uavs = [r.id for r in picked]
        free = outlook.models.positions(uavs, states, wanted, outlook.times_s)
        relative += [flown[one] - free[two], free[one] - flown[two], free[one] - free[two]]
    overlaps = first_overlap_s(np.stack(relative), outlook.times_s, outlook.required)
    found = overlaps.min(axis=0)
    out: dict[Pair, float] = {}
    for k in np.flatnonzero(np.isfinite(found)):
        low, high = sorted((picked[int(one[k])].id, picked[int(two[k])].id))
        out[low, high] = float(found[k])
    return out


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


def trajectories(reports: Sequence[StateReport], now_ns: int, outlook: Outlook) -> Array:
    """What each UAV flies from `now_ns` on, going by its report: shape (m, n, 3)."""
    intents = [r.intent() for r in reports]
    uavs, states = [r.id for r in reports], [r.state for r in reports]
    times = ages_s(reports, now_ns)[:, None] + outlook.times_s
    return outlook.models.positions(uavs, states, intents, times)


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


def _within_reach(
    reports: Sequence[StateReport], now_ns: int, outlook: Outlook
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index pairs (i < j) that could meet within the horizon at their speeds."""
    first, second = _index_pairs(len(reports))
    if not len(first):
        return first, second
    fastest = [fastest_mps(r.state, r.guidance, r.manoeuvre) for r in reports]
    table = np.array(
        [(r.state.north_m, r.state.east_m, v) for r, v in zip(reports, fastest, strict=True)]
    )
    reach = table[:, 2] * (outlook.horizon_s + ages_s(reports, now_ns))
    apart = table[first, :2] - table[second, :2]
    limit = reach[first] + reach[second] + outlook.required.horizontal_m
    near = np.hypot(apart[:, 0], apart[:, 1]) < limit
    return first[near], second[near]


@lru_cache(maxsize=8)
def _index_pairs(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    first, second = np.triu_indices(count, 1)
    return first, second
