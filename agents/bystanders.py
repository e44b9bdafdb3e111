"""Bystanders: whom the resolver need not look at in a round, told before anything is predicted.

Most UAVs that a computing UAV hears are too far away to come near its group within twice T_s. They
change nothing of the round, to the last bit, and are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from fleet.model.conflict.risk import Growth
from fleet.model.conflict.tracks import StateReport
from fleet.model.units import to_s

SLACK_M = 1.0
"""Errors of rounding never make anybody a bystander."""


@dataclass(frozen=True, slots=True)
class Bystanders:
    """How far ahead and how far round a group it is looked, and how fast who may fly.

    `commanded_mps` gives the greatest speed that a UAV may be commanded, by its ID and a speed at
    which it may cruise; it grows with that.
    """

    horizon_s: float
    apart_m: float
    growth: Growth
    commanded_mps: Callable[[int, float], float]

    def left_out(
        self, reports: Sequence[StateReport], group: Collection[int], now_ns: int, start_ns: int
    ) -> list[StateReport]:
        """The reports without those of bystanders, in the same order.

        `now_ns` is the moment of the round, `start_ns` that from which flights are predicted.
        """
        members = [r for r in reports if r.id in group]
        if not members:
            return list(reports)
        first_ns = min(r.t_ns for r in reports)
        oldest_s = max(0.0, to_s(now_ns - first_ns))
        south, north, west, east = self._box(members, oldest_s, start_ns)
        grows = bool(self.growth)
        out = []
        for report in reports:
            passed_s = max(0.0, to_s(start_ns - report.t_ns))
            way_m = self._fastest_mps(report) * (self.horizon_s + passed_s)
            state = report.state
            if (
                (
                    south - way_m <= state.north_m <= north + way_m
                    and west - way_m <= state.east_m <= east + way_m
                )
                or (grows and report.t_ns == first_ns)  # it says how far zones have grown
            ):
                out.append(report)
        return out

    def _box(
        self, members: Sequence[StateReport], oldest_s: float, start_ns: int
    ) -> tuple[float, float, float, float]:
        """The least and the greatest north and east that any zone of the group can come to."""
        zone_m = self.apart_m + self.growth.horizontal_mps * 2.0 * oldest_s + SLACK_M
        boxes = []
        for report in members:
            passed_s = max(0.0, to_s(start_ns - report.t_ns))
            reach_m = self._fastest_mps(report) * (self.horizon_s + passed_s) + zone_m
            north, east = report.state.north_m, report.state.east_m
            boxes.append((north - reach_m, north + reach_m, east - reach_m, east + reach_m))
        south, north_most, west, east_most = zip(*boxes, strict=True)
        return min(south), max(north_most), min(west), max(east_most)

    def _fastest_mps(self, report: StateReport) -> float:
        """No less than the greatest speed at which a UAV may fly until the horizon."""
        speed_mps, told_mps = report.state.speed_mps, report.guidance.speed_mps
        if told_mps == speed_mps and report.manoeuvre is None:  # as nearly always
            return max(speed_mps, self.commanded_mps(report.id, speed_mps))
        manoeuvre_mps = report.manoeuvre.speed_mps if report.manoeuvre else math.nan
        cruises = [v for v in (speed_mps, told_mps, manoeuvre_mps) if not math.isnan(v)]
        return max(*cruises, *(self.commanded_mps(report.id, v) for v in cruises))
