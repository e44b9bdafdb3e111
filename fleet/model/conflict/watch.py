"""Conflict detection from update to update: who surely still is at risk is not searched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fleet.model.conflict.detection import conflicts, released, trajectories
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.tracks import StateReport
from fleet.model.conflict.witness import first_deep, is_deep
from fleet.model.types import Pair, Position
from fleet.model.units import to_s


@dataclass(frozen=True, slots=True)
class PairWitness:
    """When a pair is deep in each other's zones, in s from now, and who of them if released."""

    at_s: float
    released: tuple[bool, bool]


class ConflictWatch:
    """Who is at risk, the same as `conflicts` says, but how soon only if that is asked."""

    def __init__(self, outlook: Outlook) -> None:
        self._outlook = outlook
        self._witnesses: dict[Pair, PairWitness] = {}
        self._found: dict[Pair, float] = {}
        self._sure: list[StateReport] = []
        self._now_ns = 0

    def at_risk(self, reports: Sequence[StateReport], now_ns: int) -> tuple[Pair, ...]:
        """The pairs at risk within the horizon from `now_ns`, in order."""
        by_id = {r.id: r for r in reports}
        sure = {pair for pair in self._witnesses if self._holds(pair, by_id, now_ns)}
        self._found = conflicts(reports, now_ns, self._outlook, sure=sure)
        self._now_ns, self._sure = now_ns, [r for r in reports if any(r.id in p for p in sure)]
        self._witnesses = {pair: self._witnesses[pair] for pair in sure}
        for pair in self._found.keys() - sure:
            self._learn(pair, [by_id[uav] for uav in pair])
        return tuple(sorted(sure | self._found.keys()))

    def soon_s(self, pairs: Sequence[Pair]) -> tuple[float, ...]:
        """How soon pairs of the last search are at risk, in s."""
        if any(pair not in self._found for pair in pairs):
            self._found = {**self._found, **conflicts(self._sure, self._now_ns, self._outlook)}
        return tuple(self._found[pair] for pair in pairs)

    def _holds(self, pair: Pair, by_id: Mapping[int, StateReport], now_ns: int) -> bool:
        """Whether the witness of a pair still is one."""
        if not all(uav in by_id for uav in pair):
            return False
        witness = self._witnesses[pair]
        one, other = (
            self._place(by_id[uav], now_ns, witness.at_s, free=free)
            for uav, free in zip(pair, witness.released, strict=True)
        )
        return is_deep(one, other, self._outlook.required_of(pair))

    def _place(self, report: StateReport, now_ns: int, at_s: float, *, free: bool) -> Position:
        """Where a UAV is so long from now on, by what it flies, or if it were released."""
        model, age_s = self._outlook.models.of(report.id), max(0.0, to_s(now_ns - report.t_ns))
        if not (free and report.manoeuvre):
            return model.after(report.state, report.intent(), age_s + at_s).position_ned_m
        state = model.after(report.state, report.intent(), age_s)
        return model.after(state, report.guidance.after(age_s), at_s).position_ned_m

    def _learn(self, pair: Pair, reports: Sequence[StateReport]) -> None:
        """Look for a witness of a pair that is at risk."""
        paths = np.stack(
            [find(reports, self._now_ns, self._outlook) for find in (trajectories, released)]
        )
        ways = ((False, False), (False, True), (True, False), (True, True))
        relative = np.stack([paths[int(a), 0] - paths[int(b), 1] for a, b in ways])
        deep = first_deep(relative, self._outlook.required_of(pair))
        if deep is not None:
            row, sample = deep
            at_s = float(self._outlook.times_s[sample])
            self._witnesses[pair] = PairWitness(at_s, ways[row])
