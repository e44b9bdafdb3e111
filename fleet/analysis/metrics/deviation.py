"""How far each UAV was from its plan, for how long, and whether and when it arrived."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.analysis.arrival import Arrival, ArrivalMonitor, Arrivals
from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.data import UNMANNED_MODES, RunArrays
from fleet.analysis.metrics.results import UavMetrics
from fleet.analysis.planned import Planned, Tolerance, deviations
from fleet.analysis.relative_motion import Bools
from fleet.model.conflict.tracks import AVOIDING
from fleet.model.units import to_s
from fleet.protocol.messages import Truth


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
        _measure(row, flown[uav.id], monitor.planned(uav.id), tolerance)
        for uav, row in zip(data.uavs, arrivals.rows, strict=True)
        if flown[uav.id]
    )


def _measure(
    arrival: Arrival, truths: Sequence[Truth], planned: Planned, tolerance: Tolerance
) -> UavMetrics:
    times_ns = np.array([m.t_ns for m in truths], dtype=np.int64)
    places = np.array([m.position_ned_m for m in truths])
    modes = np.array([m.mode for m in truths])
    path_m, altitude_m = deviations(planned.corners, places)
    off = tolerance.off(path_m, altitude_m)
    commanded, unmanned = np.isin(modes, list(AVOIDING)), np.isin(modes, UNMANNED_MODES)
    lasting_ns = np.diff(times_ns, append=times_ns[-1])
    return UavMetrics(
        arrival.id,
        arrival.aircraft,
        arrival.arrived,
        arrival.arrival_s,
        arrival.planned_arrival_s,
        arrival.due,
        arrival.delay_s,
        to_s(int(times_ns[-1] - times_ns[0])),
        to_s(int(lasting_ns[commanded].sum())),
        to_s(int(lasting_ns[unmanned].sum())),
        float(path_m.mean()),
        float(path_m.max()),
        float(altitude_m.mean()),
        float(altitude_m.max()),
        to_s(int(lasting_ns[off].sum())),
        _over_s(times_ns, commanded),
        not bool(off[-1]),
        _over_s(times_ns, off),
    )


def _over_s(times_ns: Ints, going_on: Bools) -> float | None:
    """When something was over for good, of what went on at these times; None if never, or not."""
    last = np.flatnonzero(going_on)
    if not len(last) or last[-1] == len(times_ns) - 1:
        return None
    return to_s(int(times_ns[last[-1] + 1]))
