"""The search for one UAV's manoeuvre: which candidate is chosen, and what was found of each.

Candidates are tried in stages, each only when the one before has no safe candidate:

    axis      the sector's axis: turns for head-on and rear, climbs for side encounters
    other     the other axis
    speed     course and altitude of the plan at another speed, if the scenario allows speeds; then
              it is compared with the axes, too
    both      turn and climb together
    priority  as above, but leaving room only for those resolved before, not for those still to come
    tight     the one with the greatest least separation, where that is enough but for the margin
    least_bad the same where it is not enough
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.agents.advisory import Aircraft, Candidate
from fleet.agents.candidates import CandidateSets, Stage, reverses
from fleet.agents.geometry import Geometry, Others
from fleet.agents.ranks import ranks
from fleet.agents.sectors import axis_of
from fleet.model.conflict.tracks import ActiveManoeuvre, intent_of
from fleet.model.elementary import dist
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.intent import Intent

LEVEL_MPS = 0.05
CHUNK = 8
LOOKED_UP = (Stage.AXIS, Stage.SPEED, Stage.OTHER, Stage.BOTH)
"""The families in the order in which they are looked at for a safe candidate."""

LOOKED_AT = 24
"""Of so many safe candidates of a family, the cheapest, it is asked whether they can be ended."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a UAV is resolved among: the `others` as they fly by now, `before` those not to come.

    `free` (n, 3) is its own trajectory under guidance; `rest` tells of the others who they are, and
    what they fly to.
    """

    free: Array
    others: Others
    before: Others
    rest: Sequence[tuple[int, State, Intent]]


@dataclass(frozen=True, slots=True)
class ChosenCandidate:
    """The candidate taken, with its trajectory (n, 3) and how it was found."""

    candidate: Candidate
    stage: str
    positions: Array
    intent: Intent


@dataclass(frozen=True, slots=True)
class _Look:
    """What was found of m candidates: trajectories (m, n, 3), first overlaps and costs (m,)."""

    candidates: Sequence[Candidate]
    paths: Array
    others: Others
    first_s: Array
    safe: NDArray[np.bool_]
    costs: Array

    @property
    def order(self) -> list[int]:
        """Indices of the safe ones, the cheapest first (eq. 10, 11)."""
        return [int(k) for k in np.argsort(self.costs, kind="stable") if self.safe[k]]


class CandidateSearch:
    """One UAV's candidates in one round."""

    def __init__(
        self,
        geometry: Geometry,
        sets: CandidateSets,
        craft: Aircraft,
        sector: str,
        surroundings: Surroundings,
    ) -> None:
        self._geometry = geometry
        self._sets = sets
        self._craft = craft
        self._sector = sector
        self._around = surroundings
        self._looks: dict[str, _Look] = {}

    def considered(self) -> tuple[Candidate, ...]:
        """All candidates that were looked at, with what was found."""
        return tuple(judged for look in self._looks.values() for judged in self._judged(look))

    def homeward(self) -> ChosenCandidate | None:
        """The cheapest that is safe, can be ended within 2 T_s and does not reverse, if any."""
        for stage, candidates in self._families():
            look = self._look([c for c in candidates if not reverses(self._craft, c)])
            self._looks[stage] = look
            index = self._returning(look)
            if index is not None:
                return self._chosen(look, index, stage)
        return None

    def choose(self) -> ChosenCandidate:
        """The cheapest safe candidate of the first family that has any.

        Those go first that can be ended within 2 T_s. Where speeds are allowed, that of the axis is
        compared with the speed, and with the other axis, as `_enough` says.
        """
        families, looks = dict(self._families()), self._looks
        found: list[ChosenCandidate] = []
        for stage in [s for s in LOOKED_UP if s in families]:
            if found and self._enough(stage, found):
                continue
            look = looks[stage] = self._look(families[stage])
            if look.safe.any():
                index = self._returning(look)
                found.append(self._chosen(look, look.order[0] if index is None else index, stage))
        if found:
            return self._least_aside(found)
        return self._first_come(families) or self._least_bad([looks[stage] for stage in families])

    def _first_come(self, stages: Iterable[str]) -> ChosenCandidate | None:
        """The first that leaves room for those resolved before, if not for those still to come."""
        before = self._around.before
        if len(before) == len(self._around.others):
            return None
        for stage in stages:
            known = self._looks[stage]
            look = self._look(known.candidates, known.paths, before)
            if look.safe.any():
                self._looks[stage] = look
                return self._chosen(look, look.order[0], Stage.PRIORITY)
        return None

    def _least_bad(self, looks: Sequence[_Look]) -> ChosenCandidate:
        """The one with the greatest least separation, where none is safe."""
        others = self._around.others
        candidates = [c for look in looks for c in look.candidates]
        every = np.concatenate([look.paths for look in looks])
        costs = np.concatenate([look.costs for look in looks])
        worth = ranks(every, others, self._geometry.required) - 1e-3 * costs
        worth[~self._geometry.allowed(every)] = -1.0
        best = int(np.argmax(worth))
        candidate, path = candidates[best], every[best]
        tight = self._geometry.clear(path, others, candidate.manoeuvre)
        stage = Stage.TIGHT if tight else Stage.LEAST_BAD
        return ChosenCandidate(candidate, stage, path, self._intent(candidate))

    def _enough(self, stage: str, found: list[ChosenCandidate]) -> bool:
        """Whether a family need not be looked at, after what has been found in those before.

        The other axis: if that of the sector has a candidate, and a speed leads less far from the
        plan or the manoeuvre will be over within T_s.
        """
        rules = self._sets.rules
        if stage != Stage.OTHER or not rules.speed_candidates:
            return stage != Stage.SPEED
        best = self._least_aside(found)
        over = best.stage == Stage.SPEED or self._times_s(best.intent)[0] <= rules.horizon_s
        return found[0].stage == Stage.AXIS and over

    def _least_aside(self, found: list[ChosenCandidate]) -> ChosenCandidate:
        """The choice by which a UAV is least far from its plan when the manoeuvre ends."""

        def aside_m(chosen: ChosenCandidate) -> float:
            manoeuvre_s, _ = self._times_s(chosen.intent)
            end = np.searchsorted(self._geometry.outlook.times_s, manoeuvre_s)
            return dist(chosen.positions[end].tolist(), self._around.free[end].tolist())

        return found[0] if len(found) == 1 else min(found, key=aside_m)

    def _families(self) -> list[tuple[Stage, list[Candidate]]]:
        craft, then = self._craft, self._craft.guidance.then
        levels = self._geometry.levels(self._around.free, self._around.others)
        climbs = (craft.guidance.climb_mps, then.climb_mps if then else 0.0)
        climbing = max(map(abs, climbs)) > LEVEL_MPS
        return self._sets.families(axis_of(self._sector), levels, craft, climbing=climbing)

    def _look(
        self,
        candidates: Sequence[Candidate],
        paths: Array | None = None,
        others: Others | None = None,
    ) -> _Look:
        if paths is None:
            intents = [self._intent(c) for c in candidates]
            craft, count = self._craft, len(intents)
            paths = self._geometry.positions([craft.id] * count, [craft.state] * count, intents)
        others = self._around.others if others is None else others
        first_s = self._geometry.first_overlaps_s(candidates, paths, others)
        safe = self._geometry.allowed(paths) & np.isinf(first_s)
        costs = self._sets.costs(self._craft, self._sector, candidates)
        return _Look(candidates, paths, others, first_s, safe, costs)

    def _judged(self, look: _Look) -> Iterable[Candidate]:
        least = self._geometry.least_separations(look.paths, look.others)
        found = (look.safe, look.first_s, least, look.costs)
        rows = zip(*(column.tolist() for column in found), strict=True)
        for candidate, (safe, first_s, separation, cost) in zip(look.candidates, rows, strict=True):
            yield candidate.judged(
                safe=safe, first_overlap_s=first_s, least_separation=separation, cost=cost
            )

    def _returning(self, look: _Look) -> int | None:
        """The first safe one, of the cheapest `LOOKED_AT`, that can be ended within 2 T_s."""
        order = look.order[:LOOKED_AT]
        for start in range(0, len(order), CHUNK):
            chunk = order[start : start + CHUNK]
            intents = [self._intent(look.candidates[k]) for k in chunk]
            returning = self._geometry.returning(
                self._craft, intents, self._around.rest, self._around.others.scale
            )
            index = next((k for k, ends in zip(chunk, returning, strict=True) if ends), None)
            if index is not None:
                return index
        return None

    def _chosen(self, look: _Look, index: int, stage: str) -> ChosenCandidate:
        candidate = look.candidates[index]
        return ChosenCandidate(candidate, stage, look.paths[index], self._intent(candidate))

    def _times_s(self, intent: Intent) -> tuple[float, float]:
        around = self._around
        return self._geometry.manoeuvre_times_s(
            self._craft, intent, around.rest, around.others.scale
        )

    def _intent(self, candidate: Candidate) -> Intent:
        """What the UAV flies to if it is told this."""
        guidance = self._craft.guidance
        manoeuvre = ActiveManoeuvre(
            candidate.manoeuvre,
            wrap_angle(guidance.heading_rad + candidate.turn_rad),
            candidate.climb_mps,
            candidate.level_down_m,
            candidate.speed_mps,
        )
        return intent_of(guidance, manoeuvre)
