"""The metrics of a run, from what it left behind (docs/metrics.md defines each).

`measure(RecordedRun.of_log(path))` measures a log; a run in memory is measured without a file, from
a `RunRecorder` that writes into `RecordCollector`.
"""

from __future__ import annotations

from collections.abc import Sequence

from fleet.analysis.arrival import Arrivals
from fleet.analysis.metrics.commands import measure_commands
from fleet.analysis.metrics.data import RunArrays, run_arrays
from fleet.analysis.metrics.deviation import measure_uavs
from fleet.analysis.metrics.leadership import Leadership, measure_elections
from fleet.analysis.metrics.links import measure_links
from fleet.analysis.metrics.pairs import measure_pairs
from fleet.analysis.metrics.results import (
    NMAC,
    CommandMetrics,
    CommandRow,
    ElectionMetrics,
    Incursion,
    Incursions,
    LinkMetrics,
    PairMetrics,
    RunMetrics,
    SafetyTotals,
    Spread,
    TermRow,
    UavMetrics,
    Volume,
)
from fleet.analysis.planned import Tolerance
from fleet.analysis.recorded_run import RecordCollector, RecordedRun

__all__ = (
    "NMAC",
    "CommandMetrics",
    "CommandRow",
    "ElectionMetrics",
    "Incursion",
    "Incursions",
    "LinkMetrics",
    "PairMetrics",
    "RecordCollector",
    "RecordedRun",
    "RunArrays",
    "RunMetrics",
    "SafetyTotals",
    "Spread",
    "TermRow",
    "Tolerance",
    "UavMetrics",
    "Volume",
    "load",
    "measure",
)

ZONE = "zone"
"""The volume that separation is about: both protected zones together."""


def measure(
    source: RecordedRun | RunArrays,
    volumes: Sequence[Volume] = (NMAC,),
    tolerance: Tolerance | None = None,
) -> RunMetrics:
    """Measure a run.

    Besides the required separation, incursions into `volumes` are looked for. `tolerance` says how
    near to its plan a UAV is on it.
    """
    data = source if isinstance(source, RunArrays) else run_arrays(source)
    zone = data.scenario.required()
    required = Volume(ZONE, zone.horizontal_m, zone.vertical_m)
    leadership = Leadership(data)
    pairs = measure_pairs(data, required, volumes, leadership)
    arrivals, uavs = measure_uavs(data, tolerance or Tolerance())
    classes, links = measure_links(data)
    return RunMetrics(
        data.scenario,
        data.plan,
        data.realtime,
        data.complete,
        data.end_ns / 1e9,
        required,
        tuple(volumes),
        totals(pairs, uavs, arrivals, volumes),
        pairs,
        uavs,
        measure_commands(data),
        measure_elections(data, leadership),
        classes,
        links,
    )


def totals(
    pairs: Sequence[PairMetrics],
    uavs: Sequence[UavMetrics],
    arrivals: Arrivals,
    volumes: Sequence[Volume],
) -> SafetyTotals:
    """What all pairs and UAVs make together."""
    lost = [pair for pair in pairs if pair.losses.count]
    entered = {
        volume.name: sum(pair.volumes[n].count for pair in pairs)
        for n, volume in enumerate(volumes)
    }
    return SafetyTotals(
        len(pairs),
        pairs[0].least_separation if pairs else None,
        len(lost),
        sum(pair.losses.count for pair in lost),
        sum(pair.losses.duration_s for pair in lost),
        max((pair.losses.severity for pair in lost), default=0.0),
        entered,
        sum(pair.alerted_s is not None for pair in pairs),
        sum(pair.alert_lead_s is None or pair.alert_lead_s < 0.0 for pair in lost),
        max((uav.path_deviation_max_m for uav in uavs), default=0.0),
        max((uav.altitude_deviation_max_m for uav in uavs), default=0.0),
        **arrivals.totals(),
    )
