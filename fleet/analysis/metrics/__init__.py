"""The metrics of a run, from what it left behind (docs/metrics.md defines each).

`measure(RecordedRun.of_log(path))` measures a log; a run in memory is measured without a file, from
a `RunRecorder` that writes into `RecordCollector`.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from types import NoneType

from fleet.analysis.metrics.commands import CommandMetrics, CommandRow, measure_commands
from fleet.analysis.metrics.data import RunArrays, run_arrays
from fleet.analysis.metrics.elections import ElectionMetrics, TermRow, measure_elections
from fleet.analysis.metrics.leadership import Leadership
from fleet.analysis.metrics.links import LinkMetrics, measure_links
from fleet.analysis.metrics.pairs import PairMetrics, measure_pairs
from fleet.analysis.metrics.results import RunMetrics
from fleet.analysis.metrics.totals import RunOnRecord, SafetyTotals
from fleet.analysis.metrics.uavs import UavMetrics, measure_uavs
from fleet.analysis.metrics.values import (
    NMAC,
    Incursion,
    Incursions,
    Spread,
    Volume,
    zone_volume,
)
from fleet.analysis.planned import Tolerance
from fleet.analysis.recorded_run import RecordCollector, RecordedRun, run_from
from fleet.arguments import require, require_each

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
    "measure",
)

ROWS = (
    RunMetrics,
    Volume,
    SafetyTotals,
    PairMetrics,
    Incursions,
    Incursion,
    UavMetrics,
    CommandMetrics,
    CommandRow,
    ElectionMetrics,
    TermRow,
    LinkMetrics,
    Spread,
)
"""All classes of rows, as docs/metrics.md tells them."""


def measure(
    source: RecordedRun | RunArrays | str | PathLike[str],
    volumes: Sequence[Volume] = (NMAC,),
    tolerance: Tolerance | None = None,
) -> RunMetrics:
    """Measure a run, or that of a log.

    Besides the required separation, incursions into `volumes` are looked for. `tolerance` says how
    near to its plan a UAV is on it.

    Raises:
        LogError: the log cannot be read. ArgumentError: an argument is nothing of the kind.

    """
    require_each(volumes, Volume, "measure", "volumes as (fleet.NMAC,)")
    require(tolerance, (Tolerance, NoneType), "measure", "a fleet.Tolerance")
    data = source if isinstance(source, RunArrays) else run_arrays(run_from(source, "measure"))
    leadership = Leadership(data)
    pairs = measure_pairs(data, volumes, leadership)
    arrivals, uavs = measure_uavs(data, tolerance or Tolerance())
    classes, links = measure_links(data)
    return RunMetrics(
        data.scenario,
        data.plan,
        data.realtime,
        data.complete,
        data.end_ns / 1e9,
        zone_volume(data.scenario.required()),
        tuple(volumes),
        SafetyTotals.of(RunOnRecord(data, pairs, uavs, arrivals, volumes)),
        pairs,
        uavs,
        measure_commands(data),
        measure_elections(data, leadership),
        classes,
        links,
    )
