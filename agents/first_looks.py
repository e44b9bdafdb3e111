"""What a round asks of each member first: is its plan free, and does it raise an alert as it flies.

Asked of all members together, while everybody flies what it flew at the beginning of the round.
Most rounds end with that, and a few arrays cost less than as many for each member.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from fleet.agents.advisory import Aircraft
from fleet.agents.geometry import Geometry, to_units
from fleet.model.conflict.blocks import FEW_PAIRS
from fleet.model.types import Array, Pair


@dataclass(frozen=True, slots=True)
class Flights:
    """Trajectories (N, n, 3): which row is what each UAV flies, and which its plan alone."""

    paths: Array
    flown: Mapping[int, int]
    free: Mapping[int, int]

    def relative_m(self, pairs: Sequence[Pair], *, plan: bool) -> Array:
        """The first of each pair, or its plan, as seen from the second: shape (p, n, 3)."""
        first = self.free if plan else self.flown
        one, two = [first[i] for i, _ in pairs], [self.flown[j] for _, j in pairs]
        relative: Array = self.paths[one] - self.paths[two]
        return relative


class FirstLook(NamedTuple):
    """When a member's plan, and what it flies, first overlap with anybody, in s; inf: not at all.

    The plan is looked at where a manoeuvre is flown, for 2 T_s and with margin; what is flown for
    as long as an alert is raised.
    """

    free_s: float
    alert_s: float


def first_looks(
    geometry: Geometry,
    aircraft: Mapping[int, Aircraft],
    near: Mapping[int, Sequence[int]],
    flights: Flights,
) -> dict[int, FirstLook]:
    """The first look at each member, given who is near each; of nobody if these are too many."""
    pairs = [(target, other) for target, others in near.items() for other in others]
    if len(pairs) > FEW_PAIRS:
        return {}

    def firsts_s(asked: Sequence[Pair], *, plan: bool) -> dict[int, float]:
        out = dict.fromkeys(near, math.inf)
        if asked:
            ages_s = [aircraft[i].age_s + aircraft[j].age_s for i, j in asked]
            scale = geometry.scale(asked, ages_s)
            relative = to_units(flights.relative_m(asked, plan=plan), scale)
            overlaps_s = geometry.first_overlap_s(relative, alert=not plan).tolist()
            for (target, _), first_s in zip(asked, overlaps_s, strict=True):
                out[target] = min(out[target], first_s)
        return out

    plans_s = firsts_s([p for p in pairs if aircraft[p[0]].manoeuvre], plan=True)
    alerts_s = firsts_s(pairs, plan=False)
    looks = {}
    for target in near:
        free_s, alert_s, flown = plans_s[target], alerts_s[target], aircraft[target].manoeuvre
        ahead_s = geometry.alert_for_s(flown.manoeuvre if flown else "")
        looks[target] = FirstLook(
            free_s if free_s <= geometry.free_for_s[""] else math.inf,
            alert_s if alert_s <= ahead_s else math.inf,
        )
    return looks
