"""The paper's resolution: eq. 10 (turns) and eq. 11 (climbs and dives), and what it leaves open.

One round goes through the group in ID order. Each UAV's options are compared with the trajectories
of all others: those already resolved in this round as resolved, the rest as they fly now. Options
are tried in stages, each only when the one before has no safe option:

    axis      the sector's axis: turns for head-on and rear, climbs for side encounters
    other     the other axis
    speed     course and altitude of the plan at another speed, if the scenario allows speeds; then
              it is compared with the axes, too
    both      turn and climb together
    priority  as above, but leaving room only for those resolved before, not for those still to come
    tight     the option with the greatest least separation, where that is enough but for the margin
    least_bad the same where it is not enough

Where somebody's best is `least_bad`, the computing UAV manoeuvres too (stage `own`), and those are
tried again. Whatever the stage, an advisory is told with the least separation from what all others
fly at the end of the round: below 1 the conflict is unresolved.

An alert is an overlap within T_s. What is chosen or returned to must be clear for twice as long and
by a margin, so that the next round does not have to undo it; a manoeuvre is kept until it raises an
alert itself, and ends once guidance's trajectory is free.

Overlap and clearance are measured in `fleet.agents.geometry`, from zones that may grow with the age
of what is known of both UAVs; only the least separation reported is relative to the required one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fleet.agents.advisory import Advisory, Aircraft, Situation
from fleet.agents.candidates import Candidate, CandidateSets, ChosenCandidate, reverses
from fleet.agents.geometry import Geometry, Others
from fleet.agents.sectors import axis_of, sector_of
from fleet.config.scenario import Scenario
from fleet.model.conflict.tracks import ActiveManoeuvre, fastest_mps, intent_of
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.intent import Intent

LEVEL_MPS = 0.05
CHUNK = 8
LOOKED_UP = ("axis", "speed", "other", "both")
"""The families in the order in which they are looked at for a safe option."""

LOOKED_AT = 24
"""Of so many safe options of a family, the cheapest, it is asked whether they can be ended."""


class GeometricResolver:
    """Chosen by `resolver = "geometric"`."""

    def __init__(self, scenario: Scenario) -> None:
        self._options = CandidateSets(scenario)
        self._geometry = Geometry(scenario)

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        """One round; see the module."""
        return _ResolutionRound(self._geometry, self._options, situation).advise()


class _ResolutionRound:
    """One round of the resolver: what each UAV flies, updated as the round goes on."""

    def __init__(self, geometry: Geometry, candidates: CandidateSets, situation: Situation) -> None:
        self._geometry = geometry
        self._options = candidates
        self._s = situation
        self._by_id = {a.id: a for a in situation.aircraft}
        ids = list(self._by_id)
        states = [self._by_id[i].state for i in ids]
        self._intents = {
            i: intent_of(self._by_id[i].guidance, self._by_id[i].manoeuvre) for i in ids
        }
        flown = geometry.positions(ids, states, [self._intents[i] for i in ids])
        free = flown
        if any(a.manoeuvre for a in situation.aircraft):
            free = geometry.positions(ids, states, [self._by_id[i].guidance for i in ids])
        self._flown = dict(zip(ids, flown, strict=True))
        self._free = dict(zip(ids, free, strict=True))
        self._settled = {i for i in ids if i not in situation.members or i in situation.unreachable}
        self._settled.add(situation.computing)
        self._oldest_s = max((a.age_s for a in situation.aircraft), default=0.0)
        self._within_reach: dict[int, list[int]] = {}

    def advise(self) -> list[Advisory]:
        """Everybody's advisories, in ID order; the computing UAV's own last."""
        own = self._s.computing
        advisory = []
        for target in self._s.members:
            if target != own and target in self._by_id and target not in self._s.unreachable:
                advisory.append(self._one(target))
                self._settled.add(target)
        stuck = [a.target for a in advisory if a is not None and a.stage == "least_bad"]
        alone = own in self._by_id and self._alone()
        if own in self._by_id and (stuck or alone or self._by_id[own].manoeuvre):
            self._settled.discard(own)
            mine = self._one(own, may_start=bool(stuck) or alone)
            if mine and mine.stage not in ("keep", "clear", "least_bad"):
                mine = replace(mine, stage="own")
                self._settled.add(own)
                again = {target: self._one(target) for target in stuck}
                advisory = [again.get(a.target, a) if a else None for a in advisory]
            advisory.append(mine)
        return [self._foreseen(a) for a in advisory if a is not None]

    def _foreseen(self, advisory: Advisory) -> Advisory:
        """With the least separation from what all others fly by now.

        A manoeuvre that is kept has been looked at for T_s only: what comes later is not yet
        decided.
        """
        others = self._others(advisory.target, self._flown)
        path = self._flown[advisory.target]
        least = self._geometry.least_separation(path, others, alert=advisory.stage == "keep")
        return replace(advisory, least_separation=least)

    def _alone(self) -> bool:
        """Whether the computing UAV is in conflict with one that does not answer."""
        own, unreachable = self._s.computing, self._s.unreachable
        paths = {i: path for i, path in self._flown.items() if i in unreachable}
        if not paths:
            return False
        others = self._others(own, paths)
        return not math.isinf(self._geometry.first_alert_s(self._flown[own], others))

    def _one(self, target: int, may_start: bool = True) -> Advisory | None:
        """The advisory for a UAV: nothing, keep, resume, or a manoeuvre; updates what it flies."""
        craft = self._by_id[target]
        others = self._others(target, self._flown)
        free, flown = self._free[target], self._flown[target]
        if craft.manoeuvre is None:
            first = self._geometry.first_alert_s(free, others)
            if math.isinf(first) or not may_start:
                return None
        else:
            first = self._first(free, others)
            if math.isinf(first):
                self._fly(target, craft.guidance, free)
                return Advisory(target, "resume", stage="clear")
        angle = self._collision_angle(target, first)
        sector = sector_of(angle, self._options.rules)
        told = craft.manoeuvre.manoeuvre if craft.manoeuvre else ""
        if craft.manoeuvre and math.isinf(self._geometry.first_alert_s(flown, others, told)):
            kept = self._kept(craft, others)
            if kept.manoeuvre_s < self._geometry.outlook.horizon_s:
                return kept
            way_home = self._homeward(craft, sector, others)
            if way_home is None:
                return kept
            chosen = way_home
        else:
            chosen = self._choose(craft, sector, others)
        self._fly(target, chosen.intent, chosen.positions)
        manoeuvre_s, intercept_s = self._times_s(craft, chosen.intent, others)
        return Advisory(
            target,
            chosen.candidate.manoeuvre,
            chosen.intent.heading_rad,
            chosen.candidate.turn_rad,
            chosen.candidate.climb_mps,
            chosen.candidate.level_down_m,
            sector,
            angle,
            first,
            chosen.stage,
            safe_candidates=chosen.safe_candidates,
            manoeuvre_s=manoeuvre_s,
            intercept_s=intercept_s,
            speed_mps=chosen.candidate.speed_mps,
        )

    def _kept(self, craft: Aircraft, others: Others) -> Advisory:
        """The manoeuvre goes on; how long, is told when it is reviewed (2 T_s: it has no end)."""
        if not craft.review:
            return Advisory(craft.id, "keep", stage="keep")
        manoeuvre_s, intercept_s = self._times_s(craft, self._intents[craft.id], others)
        return Advisory(
            craft.id, "keep", stage="keep", manoeuvre_s=manoeuvre_s, intercept_s=intercept_s
        )

    def _times_s(self, craft: Aircraft, intent: Intent, others: Others) -> tuple[float, float]:
        return self._geometry.manoeuvre_times_s(craft, intent, self._rest(craft.id), others.scale)

    def _families(
        self, craft: Aircraft, sector: str, others: Others
    ) -> list[tuple[str, list[Candidate]]]:
        levels = self._geometry.levels(self._free[craft.id], others)
        then = craft.guidance.then
        climbs = (craft.guidance.climb_mps, then.climb_mps if then else 0.0)
        climbing = max(map(abs, climbs)) > LEVEL_MPS
        return self._options.families(axis_of(sector), climbing, levels, craft)

    def _homeward(self, craft: Aircraft, sector: str, others: Others) -> ChosenCandidate | None:
        """The cheapest safe option that can be ended within 2 T_s and does not reverse, if any."""
        for stage, candidates in self._families(craft, sector, others):
            onward = [o for o in candidates if not reverses(craft, o)]
            paths = self._paths(craft, onward)
            order, count = self._safe(craft, sector, onward, paths, others)
            index = self._returning(craft, onward, order, others)
            if index is not None:
                return self._choice(craft, onward, paths, index, count, stage)
        return None

    def _choose(self, craft: Aircraft, sector: str, others: Others) -> ChosenCandidate:
        """The cheapest safe option of the first family that has any.

        Those go first that can be ended within 2 T_s. Where speeds are allowed, that of the axis is
        compared with the speed, and with the other axis, as `_enough` says.
        """
        families = dict(self._families(craft, sector, others))
        paths: dict[str, Array] = {}
        found: list[ChosenCandidate] = []
        for stage in [s for s in LOOKED_UP if s in families]:
            if found and self._enough(craft, stage, found, others):
                continue
            candidates = families[stage]
            paths[stage] = self._paths(craft, candidates)
            order, count = self._safe(craft, sector, candidates, paths[stage], others)
            if order:
                index = self._returning(craft, candidates, order, others)
                best = order[0] if index is None else index
                found.append(self._choice(craft, candidates, paths[stage], best, count, stage))
        if found:
            return self._least_aside(craft, found, others)
        before = self._others(craft.id, {i: self._flown[i] for i in self._settled})
        if len(before) < len(others):
            for stage, candidates in families.items():
                order, count = self._safe(craft, sector, candidates, paths[stage], before)
                if order:
                    return self._choice(
                        craft, candidates, paths[stage], order[0], count, "priority"
                    )
        candidates = [o for family in families.values() for o in family]
        every = np.concatenate([paths[stage] for stage in families])
        ranks = self._geometry.ranks(every, others) - 1e-3 * self._dislike(
            craft, sector, candidates
        )
        ranks[~self._geometry.allowed(every)] = -1.0
        best = int(np.argmax(ranks))
        tight = self._geometry.clear(every[best], others, candidates[best].manoeuvre)
        stage = "tight" if tight else "least_bad"
        return self._choice(craft, candidates, every, best, 0, stage)

    def _enough(
        self, craft: Aircraft, stage: str, found: list[ChosenCandidate], others: Others
    ) -> bool:
        """Whether a family need not be looked at, after what has been found in those before.

        The other axis: if that of the sector has an option, and a speed leads less far from the
        plan or the manoeuvre will be over within T_s.
        """
        if stage != "other" or not self._options.rules.speed_options:
            return stage != "speed"
        best = self._least_aside(craft, found, others)
        soon_s = self._options.rules.horizon_s
        over = best.stage == "speed" or self._times_s(craft, best.intent, others)[0] <= soon_s
        return found[0].stage == "axis" and over

    def _least_aside(
        self, craft: Aircraft, found: list[ChosenCandidate], others: Others
    ) -> ChosenCandidate:
        """The choice by which a UAV is least far from its plan when the manoeuvre ends."""

        def aside_m(chosen: ChosenCandidate) -> float:
            manoeuvre_s, _ = self._times_s(craft, chosen.intent, others)
            end = np.searchsorted(self._geometry.outlook.times_s, manoeuvre_s)
            return math.dist(chosen.positions[end], self._free[craft.id][end])

        return found[0] if len(found) == 1 else min(found, key=aside_m)

    def _safe(
        self,
        craft: Aircraft,
        sector: str,
        candidates: list[Candidate],
        paths: Array,
        others: Others,
    ) -> tuple[list[int], int]:
        """Indices of the safe options, the cheapest first (eq. 10, 11), and how many they are.

        Those that differ by their level alone count once.
        """
        safe = self._geometry.allowed(paths)
        if len(others):
            safe &= self._geometry.free(candidates, self._geometry.overlaps(paths, others))
        cost = self._dislike(craft, sector, candidates)
        order = [int(k) for k in np.argsort(cost, kind="stable") if safe[k]]
        return order, len({(candidates[k].turn_rad, candidates[k].climb_mps) for k in order})

    def _returning(
        self, craft: Aircraft, candidates: list[Candidate], order: list[int], others: Others
    ) -> int | None:
        """The first of these options, or of `LOOKED_AT`, that can be ended within 2 T_s."""
        rest = self._rest(craft.id)
        for start in range(0, min(len(order), LOOKED_AT), CHUNK):
            chunk = order[start : start + CHUNK]
            intents = [self._intent(craft, candidates[k]) for k in chunk]
            ends = self._geometry.returning(craft, intents, rest, others.scale)
            if ends.any():
                return chunk[int(np.argmax(ends))]
        return None

    def _rest(self, target: int) -> list[tuple[int, State, Intent]]:
        return [(i, self._by_id[i].state, self._intents[i]) for i in self._near(target)]

    def _dislike(self, craft: Aircraft, sector: str, candidates: list[Candidate]) -> Array:
        """Cost of each option: k1 |tc|, k2 |Hc - cc|; a reversal of sense is dearer.

        Each is relative to the greatest there is. Ties by design.
        """
        up, wanted = sector == "left", craft.guidance.climb_mps
        k1, k2 = self._options.rules.turn_cost, self._options.rules.climb_cost
        cost = k1 * np.array([abs(o.turn_rad) for o in candidates]) / self._options.widest_rad
        kept = ("turn", "speed")
        climbs = [0.0 if o.manoeuvre in kept else abs(wanted - o.climb_mps) for o in candidates]
        cost += k2 * np.array(climbs) / self._options.steepest_mps
        cruise = craft.cruise_mps
        cost += [
            abs(o.speed_mps / cruise - 1.0) if o.manoeuvre == "speed" else 0.0 for o in candidates
        ]
        here = craft.state.down_m
        cost += [
            0.0 if o.climb_mps == 0.0 else 1e-9 * abs(o.level_down_m - here) for o in candidates
        ]
        cost += [1e-6 * (o.turn_rad < 0.0 or o.speed_mps > cruise) for o in candidates]
        cost += [2e-6 * ((o.climb_mps > 0.0) != up) for o in candidates]
        if craft.manoeuvre is not None:
            cost += [10.0 * reverses(craft, o) for o in candidates]
        return cost

    def _choice(
        self,
        craft: Aircraft,
        candidates: list[Candidate],
        paths: Array,
        index: int,
        safe: int,
        stage: str,
    ) -> ChosenCandidate:
        candidate = candidates[index]
        return ChosenCandidate(candidate, stage, paths[index], self._intent(craft, candidate), safe)

    def _intent(self, craft: Aircraft, candidate: Candidate) -> Intent:
        heading = wrap_angle(craft.guidance.heading_rad + candidate.turn_rad)
        told = ActiveManoeuvre(
            candidate.manoeuvre,
            heading,
            candidate.climb_mps,
            candidate.level_down_m,
            candidate.speed_mps,
        )
        return intent_of(craft.guidance, told)

    def _paths(self, craft: Aircraft, candidates: list[Candidate]) -> Array:
        intents = [self._intent(craft, o) for o in candidates]
        count = len(intents)
        return self._geometry.positions([craft.id] * count, [craft.state] * count, intents)

    def _fly(self, target: int, intent: Intent, positions: Array) -> None:
        self._intents[target] = intent
        self._flown[target] = positions

    def _near(self, target: int) -> list[int]:
        """The others that the target could meet within 2 T_s."""
        if target not in self._within_reach:
            self._within_reach[target] = self._found_near(target)
        return self._within_reach[target]

    def _found_near(self, target: int) -> list[int]:
        here = self._by_id[target].state
        fastest = self._fastest_mps(self._by_id[target])
        horizon = self._geometry.outlook.horizon_s
        zone = self._geometry.required.horizontal_m
        zone += self._geometry.growth.horizontal_mps * (self._by_id[target].age_s + self._oldest_s)
        out = []
        for other, craft in self._by_id.items():
            s = craft.state
            reach = (self._fastest_mps(craft) + fastest) * horizon + zone
            apart = math.hypot(s.north_m - here.north_m, s.east_m - here.east_m)
            if other != target and apart < reach:
                out.append(other)
        return out

    def _fastest_mps(self, craft: Aircraft) -> float:
        """The greatest speed at which it may fly from this round on."""
        flown = fastest_mps(craft.state, craft.guidance, craft.manoeuvre)
        return max(flown, self._options.fastest_mps(craft))

    def _others(self, target: int, paths: dict[int, Array]) -> Others:
        near = [i for i in self._near(target) if i in paths]
        if not near:
            return Others(np.empty((0, *self._flown[target].shape)))
        age_s = self._by_id[target].age_s
        scale = self._geometry.scale([age_s + self._by_id[i].age_s for i in near])
        return Others(np.stack([paths[i] for i in near]), scale)

    def _first(self, path: Array, others: Others) -> float:
        if not len(others):
            return math.inf
        first = float(self._geometry.overlaps(path[None], others).min())
        return first if first <= self._geometry.free_for_s[""] else math.inf

    def _collision_angle(self, target: int, first_s: float) -> float:
        """Bearing of the target at its first overlap, relative to the computing UAV's heading."""
        own = self._s.computing
        if own == target:
            return 0.0
        times = self._geometry.outlook.times_s
        mine, its = (
            [float(np.interp(first_s, times, path[:, axis])) for axis in (0, 1)]
            for path in (self._flown[own], self._free[target])
        )
        bearing = math.atan2(its[1] - mine[1], its[0] - mine[0])
        return wrap_angle(bearing - self._by_id[own].state.heading_rad)
