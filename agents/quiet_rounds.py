"""Quiet rounds: those in which nobody is told anything new, known without predicting all flights.

As most are while a group lasts: what is flown raises no alert, and the plan is still not free. Of
the first there are closed forms (`fleet.model.conflict.apart`). That a plan is not free has a
witness: a moment at which the UAV would be deep in the zone of another one. It is looked for once,
and since the next rounds have nearly the same, two positions are then enough.

What is not certain is left to a round of the resolver, which comes to the same in any case.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from fleet.agents.advisory import Advisory, Aircraft, Situation
from fleet.agents.candidates import CandidateSets, Stage
from fleet.agents.geometry import Geometry, to_units
from fleet.agents.meetings import Meetings
from fleet.model.conflict.tracks import intent_of
from fleet.model.conflict.witness import first_deep, is_deep
from fleet.model.types import Array, Pair
from fleet.model.vehicle.corridors import Corridor
from fleet.model.words import Manoeuvre


@dataclass(frozen=True, slots=True)
class PlanWitness:
    """Who is in the way of a plan, and when that is flown into its zone, in s from the start."""

    other: int
    at_s: float


class QuietRounds:
    """What is remembered of the plans that are not free, from round to round."""

    def __init__(self, geometry: Geometry, sets: CandidateSets) -> None:
        self._geometry = geometry
        self._sets = sets
        self._witnesses: dict[int, PlanWitness] = {}

    def advisories(self, situation: Situation) -> list[Advisory] | None:
        """The advisories of a round in which all keep what they fly; None if that is not certain.

        Where zones grow it never is.
        """
        if self._geometry.growth:
            return None
        crafts = {a.id: a for a in situation.aircraft}
        asked = asked_of(situation, crafts)
        flying = [target for target in asked if crafts[target].manoeuvre]
        if not all(self._may_be_kept(crafts[target]) for target in flying):
            return None
        meetings = Meetings.of(self._geometry, self._sets, situation.aircraft)
        near = {target: meetings.near(target) for target in asked}
        if not all(self._blocked(crafts, target, near[target]) for target in flying):
            return None
        own = situation.computing
        pairs = [(i, j) for i, others in near.items() for j in others]
        pairs += [(own, i) for i in situation.unreachable if own in crafts and i in crafts]
        if not self._no_alert(crafts, pairs):
            return None
        return [Advisory(target, Manoeuvre.KEEP, stage=Stage.KEEP) for target in flying]

    def learn(self, target: int, plan: Array, near: Sequence[int], flown: Array) -> None:
        """Look for a witness of a plan (n, 3) that is not free, given what those near fly."""
        outlook = self._geometry.outlook
        soon = outlook.times_s <= self._geometry.free_for_s[""]
        scale = outlook.zones.scale([(target, other) for other in near], outlook.required)
        deep = first_deep(to_units(flown[:, soon] - plan[soon], scale), outlook.required)
        self._witnesses.pop(target, None)
        if deep is not None:
            row, sample = deep
            self._witnesses[target] = PlanWitness(near[row], float(outlook.times_s[sample]))

    def _may_be_kept(self, craft: Aircraft) -> bool:
        """Whether, if a manoeuvre is kept, that is all there is to say of it."""
        assert craft.manoeuvre is not None
        full = self._geometry.alerts_in_full(craft.manoeuvre.manoeuvre)
        return full and not craft.review and craft.id in self._witnesses

    def _blocked(self, crafts: Mapping[int, Aircraft], target: int, near: Collection[int]) -> bool:
        """Whether the plan of a UAV is certainly not free."""
        witness = self._witnesses[target]
        if witness.other not in near:
            return False
        one, other = crafts[target], crafts[witness.other]
        flown = intent_of(other.guidance, other.manoeuvre)
        mine = self._geometry.place_after(one, one.guidance, witness.at_s)
        its = self._geometry.place_after(other, flown, witness.at_s)
        required = self._geometry.outlook.required_of((target, witness.other))
        return is_deep(mine, its, required)

    def _no_alert(self, crafts: Mapping[int, Aircraft], pairs: Sequence[Pair]) -> bool:
        """Whether what they fly certainly raises no alert between any of these pairs."""
        corridors: dict[int, Corridor | None] = {}
        for i, j in pairs:
            for uav in (i, j):
                if uav not in corridors:
                    corridors[uav] = self._geometry.corridor(crafts[uav])
            one, other = corridors[i], corridors[j]
            if one is None or other is None:
                return False
            if not self._geometry.surely_no_alert((crafts[i], one), (crafts[j], other)):
                return False
        return True


def asked_of(situation: Situation, crafts: Mapping[int, Aircraft]) -> list[int]:
    """Whom a round asks first: the members that can be commanded, then itself if it manoeuvres."""
    own = situation.computing
    asked = [
        i for i in situation.members if i != own and i in crafts and i not in situation.unreachable
    ]
    return [*asked, own] if own in crafts and crafts[own].manoeuvre else asked
