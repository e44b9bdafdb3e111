"""Separation of every pair, tick by tick, from true states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fleet.model.risk import Required, normalised_separation
from fleet.model.trajectory import Array
from fleet.model.units import to_s


@dataclass(frozen=True, slots=True)
class PairMinimum:
    """The moment at which a pair was nearest, by normalised separation."""

    a: int
    b: int
    normalised: float
    horizontal_m: float
    vertical_m: float
    t_s: float


class SeparationMonitor:
    """Keeps the least normalised separation of each pair, and whether it is lost now."""

    def __init__(self, ids: Sequence[int], required: Required) -> None:
        self._ids = tuple(ids)
        self._required = required
        self._first, self._second = np.triu_indices(len(self._ids), 1)
        pairs = len(self._first)
        self._least = np.full(pairs, np.inf)
        self._relative = np.zeros((pairs, 3))
        self._t_ns = np.zeros(pairs, dtype=np.int64)

    def update(self, t_ns: int, positions_ned_m: Array) -> None:
        """Take in true positions at one tick, shape (N, 3), in the order of the IDs."""
        if not len(self._first):
            return
        relative = positions_ned_m[self._first] - positions_ned_m[self._second]
        value = normalised_separation(relative, self._required)
        nearer = value < self._least
        if nearer.any():
            self._least[nearer] = value[nearer]
            self._relative[nearer] = relative[nearer]
            self._t_ns[nearer] = t_ns

    def least(self) -> float:
        """Least normalised separation of any pair so far; inf before the first pair."""
        return float(self._least.min(initial=np.inf))

    def lost(self) -> bool:
        """Whether any pair came closer than required."""
        return self.least() < 1.0

    def minima(self) -> list[PairMinimum]:
        """Every pair's minimum, nearest pair first."""
        order = np.argsort(self._least, kind="stable")
        return [
            PairMinimum(
                self._ids[self._first[k]],
                self._ids[self._second[k]],
                float(self._least[k]),
                float(np.hypot(*self._relative[k, :2])),
                float(abs(self._relative[k, 2])),
                to_s(int(self._t_ns[k])),
            )
            for k in order
            if np.isfinite(self._least[k])
        ]
