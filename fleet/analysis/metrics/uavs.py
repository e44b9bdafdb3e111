"""How far each UAV was from its plan, for how long, and whether and when it arrived."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.arrival import Arrival, ArrivalMonitor, Arrivals
from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.data import RunArrays
from fleet.analysis.metrics.definition import Compared, MetricOf, MetricRow, Shown, metric_row
from fleet.analysis.planned import Planned, Tolerance, deviations
from fleet.analysis.relative_motion import Bools
from fleet.model.types import Array
from fleet.model.units import to_s
from fleet.model.words import AVOIDING, UNMANNED
from fleet.protocol.messages import Truth


@dataclass(frozen=True)
class UavOnRecord:
    """One UAV as it flew: what its metrics are computed from.

    It has true states, one a tick; arrays have their shape (n,).
    """

    data: RunArrays
    arrival: Arrival
    truths: Sequence[Truth]
    planned: Planned
    tolerance: Tolerance

    @cached_property
    def times_ns(self) -> Ints:
        """When they were."""
        return np.array([m.t_ns for m in self.truths], dtype=np.int64)

    @cached_property
    def modes(self) -> NDArray[np.str_]:
        """The mode in each."""
        return np.array([m.mode for m in self.truths])

    @property
    def commanded(self) -> Bools:
        """Whether it flew a manoeuvre."""
        return np.isin(self.modes, list(AVOIDING))

    @cached_property
    def deviations(self) -> tuple[Array, Array]:
        """Path deviation and altitude deviation, in m."""
        places = np.array([m.position_ned_m for m in self.truths])
        return deviations(self.planned.corners, places)

    @property
    def off(self) -> Bools:
        """Whether it was farther from its plan than the tolerance allows."""
        return self.tolerance.off(*self.deviations)

    def lasting_s(self, going_on: Bools) -> float:
        """For how long something went on; each true state stands for the time until the next."""
        lasting_ns = np.diff(self.times_ns, append=self.times_ns[-1])
        return to_s(int(lasting_ns[going_on].sum()))

    def over_s(self, going_on: Bools) -> float | None:
        """When something was over for good; None if it never went on, or still does."""
        last = np.flatnonzero(going_on)
        if not len(last) or last[-1] == len(self.times_ns) - 1:
            return None
        return to_s(int(self.times_ns[last[-1] + 1]))


def _arrival_text(row: UavMetrics) -> str:
    if not (row.arrived or row.due):
        return "not due"
    return "-" if row.arrival_s is None else f"{row.arrival_s:.1f}"


def _back_text(row: UavMetrics) -> str:
    if not row.back_on_plan:
        return "still off"
    return "-" if row.back_on_plan_s is None else f"{row.back_on_plan_s:.1f}"


uav_metric = MetricOf[UavOnRecord]()


@metric_row
class UavMetrics(MetricRow[UavOnRecord]):
    """One UAV: whether it arrived, how far avoidance took it from its plan, and for how long."""

    id: int = uav_metric("-", "its number", lambda uav: uav.arrival.id, source="-")
    aircraft: str = uav_metric(
        "-",
        "at the end: `flown`; `unmanned` if its process is dead; `vanished` if its true "
        "states end before those of others",
        lambda uav: uav.arrival.aircraft,
    )
    arrived: bool = uav_metric(
        "-",
        "whether it has reached its last waypoint while it was not unmanned",
        lambda uav: uav.arrival.arrived,
        source="docs/scenarios.md, guidance",
    )
    arrival_s: float | None = uav_metric(
        "s",
        "the first tick after that",
        lambda uav: uav.arrival.arrival_s,
        shown=Shown("arrived s", _arrival_text),
    )
    planned_arrival_s: float | None = uav_metric(
        "s",
        "the same of its planned path, flown undisturbed; blank if that does not arrive "
        "within the scenario; of a run that was cut short it is sought 2000 ticks or more "
        "beyond the record",
        lambda uav: uav.arrival.planned_arrival_s,
    )
    due: bool = uav_metric(
        "-",
        "whether `planned_arrival_s` is within the run and its aircraft is flown to the end",
        lambda uav: uav.arrival.due,
    )
    delay_s: float | None = uav_metric(
        "s",
        "`arrival_s` - `planned_arrival_s`",
        lambda uav: uav.arrival.delay_s,
        source="paper, least flight plan change",
        shown=Shown("delay s"),
    )
    flown_s: float = uav_metric(
        "s",
        "from its first true state to the last",
        lambda uav: to_s(int(uav.times_ns[-1] - uav.times_ns[0])),
    )
    commanded_s: float = uav_metric(
        "s",
        "time under a manoeuvre: mode turn, climb, turn_climb or speed",
        lambda uav: uav.lasting_s(uav.commanded),
        source="paper",
        shown=Shown("cmd. s"),
    )
    unmanned_s: float = uav_metric(
        "s",
        "time with its process stopped or dead: mode held or unmanned",
        lambda uav: uav.lasting_s(np.isin(uav.modes, list(UNMANNED))),
        source="docs/protocol, Truth",
    )
    path_deviation_mean_m: float = uav_metric(
        "m",
        "mean over the ticks of the path deviation",
        lambda uav: float(uav.deviations[0].mean()),
    )
    path_deviation_max_m: float = uav_metric(
        "m",
        "horizontal distance from the nearest point of the planned path, its maximum",
        lambda uav: float(uav.deviations[0].max()),
        symbol="d",
        source="cross-track distance; paper, least flight plan change",
        shown=Shown("path m"),
    )
    altitude_deviation_mean_m: float = uav_metric(
        "m",
        "mean over the ticks of the altitude deviation",
        lambda uav: float(uav.deviations[1].mean()),
    )
    altitude_deviation_max_m: float = uav_metric(
        "m",
        "difference of its altitude to the planned one at that nearest point, its maximum",
        lambda uav: float(uav.deviations[1].max()),
        source="as above",
        shown=Shown("alt. m"),
    )
    off_plan_s: float = uav_metric(
        "s",
        f"time with more than {Tolerance().path_m:g} m of path deviation or "
        f"{Tolerance().altitude_m:g} m of altitude deviation (`Tolerance`)",
        lambda uav: uav.lasting_s(uav.off),
        shown=Shown("off s"),
        compared=Compared(summary=sum),
    )
    released_s: float | None = uav_metric(
        "s",
        "when its last manoeuvre was over; blank if it had none, or one lasts to the end",
        lambda uav: uav.over_s(uav.commanded),
        source="paper, time to intercept",
    )
    back_on_plan: bool = uav_metric(
        "-",
        "whether it is within that tolerance at the end: true also of one that never left it, "
        "where `back_on_plan_s` is blank (in JSON `null`)",
        lambda uav: not bool(uav.off[-1]),
        source="paper, return to the flight plan",
        compared=Compared("off_plan_at_end", lambda each: sum(not back for back in each)),
    )
    back_on_plan_s: float | None = uav_metric(
        "s",
        "when it was back on its plan for good, having been off it; blank if it never left "
        "it, or is still off it at the end",
        lambda uav: uav.over_s(uav.off),
        source="paper, return to the flight plan",
        shown=Shown("back s", _back_text),
    )


def measure_uavs(data: RunArrays, tolerance: Tolerance) -> tuple[Arrivals, tuple[UavMetrics, ...]]:
    """Who arrived; and all UAVs that are on record."""
    monitor = ArrivalMonitor(data.scenario, tolerance)
    flown = {
        uav.id: [m for _, m in sorted(data.truths.get(uav.id, {}).items())] for uav in data.uavs
    }
    for ack in data.acks:
        monitor.add(ack)
    for truths in flown.values():
        for truth in truths:
            monitor.add(truth)
    arrivals = monitor.arrivals()
    return arrivals, tuple(
        UavMetrics.of(UavOnRecord(data, row, flown[uav.id], monitor.planned(uav.id), tolerance))
        for uav, row in zip(data.uavs, arrivals.rows, strict=True)
        if flown[uav.id]
    )
