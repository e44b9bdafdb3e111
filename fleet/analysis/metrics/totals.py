"""The safety of a run in a line: what all pairs and UAVs make together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fleet.analysis.arrival import Arrivals
from fleet.analysis.metrics.data import RunArrays
from fleet.analysis.metrics.definition import Compared, MetricOf, MetricRow, Shown, metric_row
from fleet.analysis.metrics.pairs import PairMetrics
from fleet.analysis.metrics.uavs import UavMetrics
from fleet.analysis.metrics.values import BY_VOLUME, Volume
from fleet.analysis.words import counted


@dataclass(frozen=True)
class RunOnRecord:
    """A whole run: what its totals are computed from. Pairs are in order of least separation."""

    data: RunArrays
    pairs: Sequence[PairMetrics]
    uavs: Sequence[UavMetrics]
    arrivals: Arrivals
    volumes: Sequence[Volume]

    @cached_property
    def lost(self) -> list[PairMetrics]:
        """The pairs that lost separation."""
        return [pair for pair in self.pairs if pair.losses.count]

    @property
    def incursions(self) -> dict[str, int]:
        """How many there were into each volume."""
        return {
            volume.name: sum(pair.volumes[n].count for pair in self.pairs)
            for n, volume in enumerate(self.volumes)
        }


def _lost_text(row: SafetyTotals) -> str:
    lost = f"{row.pairs_lost} of {counted(row.pairs, 'pair')}"
    return lost + (f" ({counted(row.losses, 'loss', 'losses')})" if row.losses else "")


def _alerts_text(row: SafetyTotals) -> str:
    return f"{counted(row.pairs_alerted, 'pair')}, missed {row.missed_alerts}"


total = MetricOf[RunOnRecord]()


@metric_row
class SafetyTotals(MetricRow[RunOnRecord]):
    """The safety of a run in a line: what all pairs make together."""

    pairs: int = total(
        "1",
        "pairs that were on record at the same time",
        lambda run: len(run.pairs),
    )
    least_separation: float | None = total(
        "1",
        "least of all pairs",
        lambda run: run.pairs[0].least_separation if run.pairs else None,
        source="see PairMetrics",
        compared=Compared(),
    )
    pairs_lost: int = total(
        "1",
        "pairs that lost separation at least once",
        lambda run: len(run.lost),
        shown=Shown("lost separation", _lost_text),
        compared=Compared(),
    )
    losses: int = total(
        "1",
        "losses of separation of all pairs",
        lambda run: sum(pair.losses.count for pair in run.lost),
        compared=Compared(),
    )
    loss_s: float = total(
        "s",
        "their durations together",
        lambda run: sum(pair.losses.duration_s for pair in run.lost),
        compared=Compared(),
    )
    severity: float = total(
        "1",
        "the greatest of their severities; 0 for none",
        lambda run: max((pair.losses.severity for pair in run.lost), default=0.0),
        compared=Compared(),
    )
    incursions: dict[str, int] = total(
        "1",
        "by volume: incursions of all pairs",
        lambda run: run.incursions,
        shown=Shown(BY_VOLUME),
        compared=Compared(),
    )
    pairs_alerted: int = total(
        "1",
        "pairs with an alert",
        lambda run: sum(pair.alerted_s is not None for pair in run.pairs),
        shown=Shown("alerts", _alerts_text),
        compared=Compared(),
    )
    missed_alerts: int = total(
        "1",
        "pairs that lost separation without an alert before",
        lambda run: sum(pair.alert_lead_s is None or pair.alert_lead_s < 0.0 for pair in run.lost),
        source="RTCA DO-365, missed alert",
        compared=Compared(),
    )
    path_deviation_max_m: float = total(
        "m",
        "greatest of all UAVs",
        lambda run: max((uav.path_deviation_max_m for uav in run.uavs), default=0.0),
        source="see UavMetrics",
        compared=Compared(),
    )
    altitude_deviation_max_m: float = total(
        "m",
        "greatest of all UAVs",
        lambda run: max((uav.altitude_deviation_max_m for uav in run.uavs), default=0.0),
        source="see UavMetrics",
        compared=Compared(),
    )
    all_arrived: str = total(
        "-",
        "`yes`; `no` if one that was due has not; `not due` if all that were due have, but "
        "others are flown that would not have arrived by their plan alone, either",
        lambda run: run.arrivals.all_arrived,
        compared=Compared(),
    )
    arrived: int = total(
        "1",
        "UAVs that have arrived",
        lambda run: sum(row.arrived for row in run.arrivals.rows),
        source="see UavMetrics",
        compared=Compared(),
    )
    due: int = total(
        "1",
        "UAVs that were due",
        lambda run: sum(row.due for row in run.arrivals.rows),
        source="see UavMetrics",
        compared=Compared(),
    )
    not_arrived: tuple[int, ...] = total(
        "-",
        "those that were due and have not arrived",
        lambda run: tuple(run.arrivals.missing),
        source="see UavMetrics",
    )
    delay_mean_s: float | None = total(
        "s",
        "mean of the delays of those that arrived",
        lambda run: run.arrivals.delay_mean_s,
        source="see UavMetrics",
        compared=Compared(),
    )
    delay_max_s: float | None = total(
        "s",
        "greatest of them",
        lambda run: run.arrivals.delay_max_s,
        source="see UavMetrics",
        compared=Compared(),
    )
