"""Conflict groups: who is in conflict with whom, and the connected components of that graph."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.model.flight import State
from fleet.model.risk import Required, first_overlap_s
from fleet.model.tracks import Report, courses_of
from fleet.model.trajectory import Aim, Array, Predictor

Pair = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Outlook:
    """How far ahead, how finely and with what separation conflicts are sought."""

    predictor: Predictor
    times_s: Array
    required: Required

    @property
    def horizon_s(self) -> float:
        """T_s."""
        return float(self.times_s[-1])


def conflicts(
    reports: Sequence[Report], states: Sequence[State], outlook: Outlook
) -> dict[Pair, float]:
    """Pairs (lower ID first) at risk over the horizon, with the time to violation in seconds.

    A pair is at risk when what either flies, or what its guidance would fly if released, overlaps
    with either of the other's: a group lasts until its escapes can be ended safely.
    """
    if len(reports) < 2:
        return {}
    first, second = _within_reach(states, outlook)
    if not len(first):
        return {}
    near = np.unique(np.concatenate([first, second]))
    place = {int(k): n for n, k in enumerate(near)}
    one = np.array([place[int(k)] for k in first])
    two = np.array([place[int(k)] for k in second])
    picked = [reports[int(k)] for k in near]
    picked_states = [states[int(k)] for k in near]
    flown = _positions(picked_states, [r.aim() for r in picked], outlook)
    free = flown
    if any(r.escape for r in picked):
        free = _positions(picked_states, [r.guidance for r in picked], outlook)
    found = _first_overlaps(flown, flown, one, two, outlook)
    if free is not flown:
        for a, b in ((flown, free), (free, flown), (free, free)):
            found = np.minimum(found, _first_overlaps(a, b, one, two, outlook))
    return {
        (picked[int(one[k])].id, picked[int(two[k])].id): float(found[k])
        for k in np.flatnonzero(np.isfinite(found))
    }


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


def _positions(states: Sequence[State], aims: Sequence[Aim], outlook: Outlook) -> Array:
    return outlook.predictor.positions(courses_of(states, aims), outlook.times_s)


def _within_reach(
    states: Sequence[State], outlook: Outlook
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index pairs (i < j) that could meet within the horizon at their speeds."""
    position = np.array([s.position_ned_m for s in states])
    reach = np.array([s.speed_mps for s in states]) * outlook.horizon_s
    first, second = np.triu_indices(len(states), 1)
    apart = position[first] - position[second]
    limit = reach[first] + reach[second]
    near = np.hypot(apart[:, 0], apart[:, 1]) < limit + outlook.required.horizontal_m
    return first[near], second[near]


def _first_overlaps(
    a: Array, b: Array, one: NDArray[np.intp], two: NDArray[np.intp], outlook: Outlook
) -> Array:
    return first_overlap_s(a[one] - b[two], outlook.times_s, outlook.required)
