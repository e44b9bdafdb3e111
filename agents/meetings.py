"""Who can meet whom in a round of the geometric resolver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fleet.agents.advisory import Aircraft
from fleet.agents.candidates import CandidateSets
from fleet.agents.geometry import Geometry
from fleet.model.conflict.tracks import fastest_mps
from fleet.model.elementary import hypot
from fleet.model.types import Array


@dataclass(frozen=True, slots=True)
class Meetings:
    """Who can meet whom within 2 T_s: IDs, and arrays (m,) of places, greatest speeds and ages."""

    ids: Sequence[int]
    north_m: Array
    east_m: Array
    fastest_mps: Array
    age_s: Array
    geometry: Geometry

    @classmethod
    def of(cls, geometry: Geometry, sets: CandidateSets, aircraft: Sequence[Aircraft]) -> Meetings:
        """Of all of a round; at the greatest speed at which each may fly from it on."""
        rows = [
            (
                a.state.north_m,
                a.state.east_m,
                max(
                    fastest_mps(a.state, a.guidance, a.manoeuvre),
                    sets.fastest_mps(a.id, a.cruise_mps),
                ),
                a.age_s,
            )
            for a in aircraft
        ]
        table = np.array(rows, dtype=np.float64).reshape(-1, 4).T.copy()
        north_m, east_m, fastest, age_s = table
        return cls([a.id for a in aircraft], north_m, east_m, fastest, age_s, geometry)

    def near(self, target: int) -> list[int]:
        """The others that the target could meet."""
        k, geometry = self.ids.index(target), self.geometry
        zone = geometry.required.horizontal_m
        zone += geometry.growth.horizontal_mps * float(self.age_s[k] + self.age_s.max())
        reach = (self.fastest_mps + self.fastest_mps[k]) * geometry.outlook.horizon_s + zone
        apart = hypot(self.north_m - self.north_m[k], self.east_m - self.east_m[k])
        return [self.ids[n] for n in np.flatnonzero(apart < reach).tolist() if n != k]
