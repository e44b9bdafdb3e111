"""Who can meet whom in a round of the geometric resolver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fleet.agents.advisory import Aircraft
from fleet.agents.candidates import CandidateSets
from fleet.agents.geometry import Geometry
from fleet.model.conflict.tracks import fastest_mps
from fleet.model.elementary import hypot


@dataclass(frozen=True, slots=True)
class Meetings:
    """Who can meet whom within 2 T_s.

    Of each UAV the ID, north, east, the greatest speed at which it may fly from now on, and age;
    and the greatest of these ages.
    """

    rows: Sequence[tuple[int, float, float, float, float]]
    oldest_s: float
    geometry: Geometry

    @classmethod
    def of(cls, geometry: Geometry, sets: CandidateSets, aircraft: Sequence[Aircraft]) -> Meetings:
        """Of all of a round."""
        rows = []
        for a in aircraft:
            flown = fastest_mps(a.state, a.guidance, a.manoeuvre)
            fastest = max(flown, sets.fastest_mps(a.id, a.cruise_mps))
            rows.append((a.id, a.state.north_m, a.state.east_m, fastest, a.age_s))
        return cls(rows, max((a.age_s for a in aircraft), default=0.0), geometry)

    def near(self, target: int) -> list[int]:
        """The others that the target could meet."""
        geometry, horizon_s = self.geometry, self.geometry.outlook.horizon_s
        _, north, east, fastest, age_s = next(row for row in self.rows if row[0] == target)
        grown_m = geometry.growth.horizontal_mps * (age_s + self.oldest_s)

        def reach_m(uav: int, speed_mps: float) -> float:
            required = geometry.zones.of_pair((target, uav), geometry.required)
            return (speed_mps + fastest) * horizon_s + (required.horizontal_m + grown_m)

        return [
            uav
            for uav, other_north, other_east, speed, _ in self.rows
            if hypot(other_north - north, other_east - east) < reach_m(uav, speed) and uav != target
        ]
