"""The paper's resolution: eq. 10 (turns) and eq. 11 (climbs and dives), and what it leaves open.

One round goes through the group in ID order. Each UAV's candidates are compared with the
trajectories of all others: those already resolved in this round as resolved, the rest as they fly
now (`fleet.agents.candidate_search`). Where somebody's best is `least_bad`, the computing UAV
manoeuvres too (stage `own`), and those are tried again. Whatever the stage, an advisory is given
with the least separation from what all others fly at the end of the round: below 1 the conflict is
unresolved.

An alert is an overlap within T_s. What is chosen or returned to must be clear for twice as long and
by a margin, so that the next round does not have to undo it; a manoeuvre is kept until it raises an
alert itself, and ends once guidance's trajectory is free.

Overlap and clearance are measured in `fleet.agents.geometry`, from zones that may grow with the age
of what is known of both UAVs; only the least separation reported is relative to the required one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from fleet.agents.advisory import Advisory, Aircraft, Situation
from fleet.agents.bystanders import Bystanders
from fleet.agents.candidate_search import CandidateSearch, Surroundings
from fleet.agents.candidates import CandidateSets, Stage
from fleet.agents.first_looks import Flights, first_looks
from fleet.agents.geometry import Geometry, Others
from fleet.agents.meetings import Meetings
from fleet.agents.quiet_rounds import QuietRounds, asked_of
from fleet.agents.sectors import sector_of
from fleet.config.scenario import Scenario
from fleet.model.conflict.tracks import StateReport, intent_of
from fleet.model.elementary import atan2
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.intent import Intent
from fleet.model.words import Manoeuvre


class GeometricResolver:
    """Chosen by `resolver = "geometric"`."""

    def __init__(self, scenario: Scenario) -> None:
        self._sets = CandidateSets(scenario)
        self._geometry = geometry = Geometry(scenario)
        self._bystanders = Bystanders(
            geometry.outlook.horizon_s,
            geometry.zones.greatest(geometry.required).horizontal_m,
            geometry.growth,
            self._sets.fastest_mps,
        )
        self._quiet = QuietRounds(geometry, self._sets)

    def concerned(
        self, reports: Sequence[StateReport], group: Collection[int], now_ns: int, start_ns: int
    ) -> list[StateReport]:
        """All but the bystanders: these change nothing, to the last bit."""
        return self._bystanders.left_out(reports, group, now_ns, start_ns)

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        """One round; see the module."""
        advisories = self._quiet.advisories(situation)
        if advisories is None:
            this = _ResolutionRound(self._geometry, self._sets, situation)
            advisories = this.advise()
            this.teach(self._quiet, advisories)
        return advisories


class _ResolutionRound:
    """One round of the resolver: what each UAV flies, updated as the round goes on."""

    def __init__(self, geometry: Geometry, sets: CandidateSets, situation: Situation) -> None:
        self._geometry = geometry
        self._sets = sets
        self._s = situation
        self._by_id = {a.id: a for a in situation.aircraft}
        ids = list(self._by_id)
        states = [self._by_id[i].state for i in ids]
        self._intents = {
            i: intent_of(self._by_id[i].guidance, self._by_id[i].manoeuvre) for i in ids
        }
        group = {*situation.members, situation.computing}
        held = [a for a in situation.aircraft if a.manoeuvre and a.id in group]
        paths = geometry.positions(
            [*ids, *(a.id for a in held)],
            [*states, *(a.state for a in held)],
            [*self._intents.values(), *(a.guidance for a in held)],
        )
        flown = {i: row for row, i in enumerate(ids)}
        free = {**flown, **{a.id: row for row, a in enumerate(held, start=len(ids))}}
        self._flown = {i: paths[row] for i, row in flown.items()}
        self._free = {i: paths[row] for i, row in free.items()}
        self._settled = {i for i in ids if i not in situation.members or i in situation.unreachable}
        self._settled.add(situation.computing)
        self._meetings = Meetings.of(geometry, sets, situation.aircraft)
        self._within_reach: dict[int, list[int]] = {}
        self._rests: dict[int, list[tuple[int, State, Intent]]] = {}
        self._others_of: dict[int, Others] = {}
        asked = asked_of(situation, self._by_id)
        self._members = [i for i in asked if i != situation.computing]
        near = {i: self._near(i) for i in asked}
        self._looks = first_looks(geometry, self._by_id, near, Flights(paths, flown, free))
        self._as_begun = True

    def advise(self) -> list[Advisory]:
        """Everybody's advisories, in ID order; the computing UAV's own last."""
        own = self._s.computing
        advisory = []
        for target in self._members:
            advisory.append(self._one(target))
            self._settled.add(target)
        stuck = [a.target for a in advisory if a is not None and a.stage == Stage.LEAST_BAD]
        alone = own in self._by_id and self._alone()
        if own in self._by_id and (stuck or alone or self._by_id[own].manoeuvre):
            self._settled.discard(own)
            mine = self._one(own, may_start=bool(stuck) or alone)
            if mine and mine.stage not in (Stage.KEEP, Stage.CLEAR, Stage.LEAST_BAD):
                mine = replace(mine, stage=Stage.OWN)
                self._settled.add(own)
                again = {target: self._one(target) for target in stuck}
                advisory = [again.get(a.target, a) if a else None for a in advisory]
            advisory.append(mine)
        return [self._foreseen(a) for a in advisory if a is not None]

    def teach(self, quiet: QuietRounds, advisories: Sequence[Advisory]) -> None:
        """Let it be known why the plans of those are not free who keep what they fly."""
        for advisory in advisories:
            target = advisory.target
            near = self._near(target)
            if advisory.stage == Stage.KEEP and near:
                quiet.learn(target, self._free[target], near, self._among(target).paths)

    def _foreseen(self, advisory: Advisory) -> Advisory:
        """With the least separation from what all others fly by now.

        A manoeuvre that is kept has been looked at for T_s only: what comes later is not yet
        decided. While nobody is told anything new it is known to be free for that long, and how
        free it is, is told when it is reviewed.
        """
        kept = advisory.stage == Stage.KEEP
        if kept and self._as_begun and self._surely_clear(self._by_id[advisory.target]):
            return advisory
        others = self._among(advisory.target)
        path = self._flown[advisory.target][None]
        least = self._geometry.least_separations(path, others, alert=kept)
        return replace(advisory, least_separation=float(least[0]))

    def _surely_clear(self, craft: Aircraft) -> bool:
        """Whether that a manoeuvre is kept says as much as is asked for."""
        assert craft.manoeuvre is not None
        return not craft.review and self._geometry.alerts_in_full(craft.manoeuvre.manoeuvre)

    def _alone(self) -> bool:
        """Whether the computing UAV is in conflict with one that does not answer."""
        own, unreachable = self._s.computing, self._s.unreachable
        paths = {i: path for i, path in self._flown.items() if i in unreachable}
        if not paths:
            return False
        others = self._others(own, paths)
        return not math.isinf(self._geometry.first_alert_s(self._flown[own], others))

    def _one(self, target: int, *, may_start: bool = True) -> Advisory | None:
        """The advisory for a UAV: nothing, keep, resume, or a manoeuvre; updates what it flies."""
        craft, kept = self._by_id[target], None
        if craft.manoeuvre is None:
            first = self._alert_s(target)
            if math.isinf(first) or not may_start:
                return None
        else:
            first = self._first(target)
            if math.isinf(first):
                self._fly(target, craft.guidance, self._free[target])
                return Advisory(target, Manoeuvre.RESUME, stage=Stage.CLEAR)
        if craft.manoeuvre and math.isinf(self._alert_s(target)):
            kept = self._kept(craft)
            if kept.manoeuvre_s < self._geometry.outlook.horizon_s:
                return kept
        angle = self._collision_angle(target, first)
        sector = sector_of(angle, self._sets.rules)
        others = self._among(target)
        search = self._search(craft, sector, others)
        chosen = search.homeward() if kept else search.choose()
        if chosen is None:
            return kept
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
            manoeuvre_s=manoeuvre_s,
            intercept_s=intercept_s,
            speed_mps=chosen.candidate.speed_mps,
            candidates=search.considered(),
        )

    def _search(self, craft: Aircraft, sector: str, others: Others) -> CandidateSearch:
        around = Surroundings(
            self._free[craft.id],
            others,
            self._others(craft.id, {i: self._flown[i] for i in self._settled}),
            self._rest(craft.id),
        )
        return CandidateSearch(self._geometry, self._sets, craft, sector, around)

    def _kept(self, craft: Aircraft) -> Advisory:
        """The manoeuvre goes on; how long, is told when it is reviewed (2 T_s: it has no end)."""
        if not craft.review:
            return Advisory(craft.id, Manoeuvre.KEEP, stage=Stage.KEEP)
        others = self._among(craft.id)
        manoeuvre_s, intercept_s = self._times_s(craft, self._intents[craft.id], others)
        return Advisory(
            craft.id,
            Manoeuvre.KEEP,
            stage=Stage.KEEP,
            manoeuvre_s=manoeuvre_s,
            intercept_s=intercept_s,
        )

    def _times_s(self, craft: Aircraft, intent: Intent, others: Others) -> tuple[float, float]:
        return self._geometry.manoeuvre_times_s(craft, intent, self._rest(craft.id), others.scale)

    def _rest(self, target: int) -> list[tuple[int, State, Intent]]:
        rest = self._rests.get(target)
        if rest is None:
            rest = [(i, self._by_id[i].state, self._intents[i]) for i in self._near(target)]
            self._rests[target] = rest
        return rest

    def _fly(self, target: int, intent: Intent, positions: Array) -> None:
        self._intents[target] = intent
        self._rests = {i: rest for i, rest in self._rests.items() if i == target}
        self._others_of = {i: others for i, others in self._others_of.items() if i == target}
        self._flown[target] = positions
        self._looks, self._as_begun = {}, False

    def _near(self, target: int) -> list[int]:
        """The others that the target could meet within 2 T_s."""
        if target not in self._within_reach:
            self._within_reach[target] = self._meetings.near(target)
        return self._within_reach[target]

    def _among(self, target: int) -> Others:
        """The others as they fly by now."""
        if target not in self._others_of:
            self._others_of[target] = self._others(target, self._flown)
        return self._others_of[target]

    def _others(self, target: int, paths: dict[int, Array]) -> Others:
        near = [i for i in self._near(target) if i in paths]
        if not near:
            return Others(np.empty((0, *self._flown[target].shape)))
        age_s = self._by_id[target].age_s
        pairs = [(target, i) for i in near]
        scale = self._geometry.scale(pairs, [age_s + self._by_id[i].age_s for i in near])
        ratio_scale = self._geometry.ratio_scale(pairs)
        return Others(np.stack([paths[i] for i in near]), scale, ratio_scale)

    def _alert_s(self, target: int) -> float:
        """When the manoeuvre of a UAV, or its plan, first raises an alert; inf if it does not."""
        if target in self._looks:
            return self._looks[target].alert_s
        manoeuvre, others = self._by_id[target].manoeuvre, self._among(target)
        if manoeuvre is None:  # also of one that has been told something in this round
            return self._geometry.first_alert_s(self._free[target], others)
        return self._geometry.first_alert_s(self._flown[target], others, manoeuvre.manoeuvre)

    def _first(self, target: int) -> float:
        """When the plan of a UAV first overlaps with anybody, with margin, within 2 T_s."""
        if target in self._looks:
            return self._looks[target].free_s
        others = self._among(target)
        if not len(others):
            return math.inf
        first = float(self._geometry.overlaps(self._free[target][None], others).min())
        return first if first <= self._geometry.free_for_s[""] else math.inf

    def _collision_angle(self, target: int, first_s: float) -> float:
        """Bearing of the target at its first overlap, relative to the computing UAV's heading."""
        own = self._s.computing
        if own == target:
            return 0.0
        times = self._geometry.outlook.times_s
        mine, its = (
            _place(path, times, first_s) for path in (self._flown[own], self._free[target])
        )
        bearing = atan2(its[1] - mine[1], its[0] - mine[0])
        return wrap_angle(bearing - self._by_id[own].state.heading_rad)


def _place(path: Array, times_s: Array, at_s: float) -> tuple[float, float]:
    """North and east on a path (n, 3) at a time, or at its end if that comes first."""
    after = min(max(1, int(np.searchsorted(times_s, at_s))), len(times_s) - 1)
    start_s, end_s = times_s[after - 1 : after + 1].tolist()
    part = min(1.0, (at_s - start_s) / (end_s - start_s))
    (north, east, _), (to_north, to_east, _) = path[after - 1 : after + 1].tolist()
    return north + part * (to_north - north), east + part * (to_east - east)
