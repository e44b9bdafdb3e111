"""Every pair of UAVs: nearest approach, incursions into volumes, and the alerts before them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from fleet.analysis import relative_motion as chords
from fleet.analysis.metrics.data import RunArrays
from fleet.analysis.metrics.definition import MetricOf, MetricRow, Shown, metric_row
from fleet.analysis.metrics.incursions import Chords, chords_of, incursions
from fleet.analysis.metrics.leadership import Leadership, RiskTimes
from fleet.analysis.metrics.values import BY_VOLUME, Incursions, Volume, zone_volume
from fleet.analysis.separation import PairMinimum, nearness_of
from fleet.analysis.words import separation_text
from fleet.model.types import COORDINATOR, Pair
from fleet.model.units import to_s


@dataclass(frozen=True)
class Alert:
    """The first time that a pair was named as being in conflict, and what was then foreseen."""

    t_ns: int
    time_to_violation_s: float | None


@dataclass(frozen=True)
class Approach:
    """Two UAVs where they were closest."""

    t_s: float
    distance_m: float
    horizontal_m: float
    vertical_m: float


@dataclass(frozen=True)
class PairOnRecord:
    """Two UAVs as they flew: what the metrics of a pair are computed from."""

    data: RunArrays
    leadership: Leadership
    least: PairMinimum
    path: Chords
    losses: Incursions
    volumes: tuple[Incursions, ...]
    alert: Alert | None

    @cached_property
    def closest(self) -> Approach:
        """The closest point of approach."""
        fraction = chords.closest(self.path.start_m, self.path.end_m)
        points = chords.along(self.path.start_m, self.path.end_m, fraction)
        distances = np.sqrt(np.sum(points * points, axis=1))
        row = int(np.argmin(distances))
        t_s = self.path.at(row, float(fraction[row]))
        north_m, east_m, down_m = points[row]
        horizontal_m = float(np.hypot(north_m, east_m))
        return Approach(t_s, float(distances[row]), horizontal_m, float(abs(down_m)))

    @property
    def true_time_to_violation_s(self) -> float | None:
        """How soon it would have violated separation at its alert, by the true states."""
        if self.alert is None:
            return None
        return self.leadership.time_to_violation_s(self.least.pair, self.alert.t_ns)

    @property
    def alert_lead_s(self) -> float | None:
        """From its alert to its first loss of separation."""
        if self.alert is None or self.losses.first_s is None:
            return None
        return self.losses.first_s - to_s(self.alert.t_ns)

    @cached_property
    def risk(self) -> RiskTimes:
        """For how long it was at risk."""
        return self.leadership.of_pair(self.least.pair)


ALERTS = "alerts"
"""The second table of pairs in `fleet metrics`."""

pair_metric = MetricOf[PairOnRecord]()


@metric_row
class PairMetrics(MetricRow[PairOnRecord]):
    """Two UAVs: how near they came, and when that was foreseen."""

    a: int = pair_metric("-", "the lower number", lambda pair: pair.least.a, source="-")
    b: int = pair_metric("-", "the higher number", lambda pair: pair.least.b, source="-")
    least_separation: float = pair_metric(
        "1",
        "min over t of s(t), with H and V of the zone",
        lambda pair: pair.least.least_separation,
        symbol="s_min",
        source="paper, eq. 4 and protected zones; normalised: ours",
        shown=Shown("normal.", lambda row: separation_text(row.least_separation)),
    )
    horizontal_m: float = pair_metric(
        "m",
        "horizontal distance then",
        lambda pair: pair.least.horizontal_m,
        symbol="h(t_s)",
    )
    vertical_m: float = pair_metric(
        "m",
        "vertical distance then",
        lambda pair: pair.least.vertical_m,
        symbol="v(t_s)",
    )
    t_s: float = pair_metric(
        "s",
        "when that first was",
        lambda pair: pair.least.t_s,
        symbol="t_s",
        shown=Shown("at s"),
    )
    cpa_m: float = pair_metric(
        "m",
        "distance at the closest point of approach, min over t of R(t)",
        lambda pair: pair.closest.distance_m,
        symbol="R_min",
        source="eq. 4; ICAO Doc 9863, CPA",
        shown=Shown("CPA m"),
    )
    cpa_at_s: float = pair_metric(
        "s",
        "when that first was. On a chord r0 + u d: u = clip(-r0.d / d.d, 0, 1)",
        lambda pair: pair.closest.t_s,
        symbol="t_CPA",
        source="as above",
    )
    horizontal_miss_m: float = pair_metric(
        "m",
        "horizontal miss distance h(t_CPA)",
        lambda pair: pair.closest.horizontal_m,
        symbol="HMD",
        source="RTCA DO-365, HMD",
        shown=Shown("horiz."),
    )
    vertical_miss_m: float = pair_metric(
        "m",
        "vertical miss distance v(t_CPA)",
        lambda pair: pair.closest.vertical_m,
        symbol="VMD",
        source="RTCA DO-365, VMD",
        shown=Shown("vert."),
    )
    losses: Incursions = pair_metric(
        "-",
        "losses of separation: [Incursions](#incursions) into `zone`",
        lambda pair: pair.losses,
        source="paper, protected zones",
        shown=Shown(BY_VOLUME),
    )
    volumes: tuple[Incursions, ...] = pair_metric(
        "-",
        "[Incursions](#incursions) into each further volume, first `nmac`; in tables the "
        "columns `incursions_nmac`, `incursions_nmac_s` (duration), `_severity` and "
        "`_first_s`",
        lambda pair: pair.volumes,
        source="RTCA DO-365, NMAC",
        shown=Shown(BY_VOLUME),
    )
    alerted_s: float | None = pair_metric(
        "s",
        "first alert: the coordinator's first `conflict` that names the pair, or the first "
        "election by a UAV that names both, whichever is earlier",
        lambda pair: to_s(pair.alert.t_ns) if pair.alert else None,
        symbol="t_A",
        source="RTCA DO-365, alert; which message: ours",
        shown=Shown("alert s", table=ALERTS),
    )
    time_to_violation_s: float | None = pair_metric(
        "s",
        "time to violation that this alert states; an election states none",
        lambda pair: pair.alert.time_to_violation_s if pair.alert else None,
        symbol="tau",
        source="eq. 9 within T_s",
        shown=Shown("to violation s", table=ALERTS),
    )
    true_time_to_violation_s: float | None = pair_metric(
        "s",
        "the same from the true states at the update of the alert; blank if the pair was not "
        "at risk then",
        lambda pair: pair.true_time_to_violation_s,
        symbol="tau*",
        source="eq. 9 within T_s",
    )
    alert_lead_s: float | None = pair_metric(
        "s",
        "from the first alert to the first loss; negative if it came too late, blank without "
        "a loss",
        lambda pair: pair.alert_lead_s,
        symbol="t_L - t_A",
        source="RTCA DO-365, alert time before loss",
        shown=Shown("lead s", table=ALERTS),
    )
    at_risk_s: float = pair_metric(
        "s",
        "for how long the pair was at risk, see [ElectionMetrics](#electionmetrics)",
        lambda pair: pair.risk.at_risk_s,
        source="eq. 9",
        shown=Shown("at risk s", table=ALERTS),
    )
    without_computing_s: float = pair_metric(
        "s",
        "for how long of that without a computing UAV",
        lambda pair: pair.risk.without_computing_s,
        shown=Shown("not led s", table=ALERTS),
    )


def measure_pairs(
    data: RunArrays, volumes: Sequence[Volume], leadership: Leadership
) -> tuple[PairMetrics, ...]:
    """All pairs that were on record at the same time, nearest first."""
    alerts, place = first_alerts(data), {uav: n for n, uav in enumerate(data.ids)}
    required, zones, found = data.scenario.required(), data.scenario.zone_ratios(), []
    near = nearness_of(data.ids, data.times_ns, data.positions_ned_m, required, zones)
    for least in near.minima:
        relative_m = data.positions_ned_m[place[least.a]] - data.positions_ned_m[place[least.b]]
        path = chords_of(relative_m, data.times_ns)
        zone = zone_volume(zones.of_pair(least.pair, required))
        losses, *others = (incursions(path, volume) for volume in (zone, *volumes))
        alert = alerts.get(least.pair)
        pair = PairOnRecord(data, leadership, least, path, losses, tuple(others), alert)
        found.append(PairMetrics.of(pair))
    return tuple(found)


def first_alerts(data: RunArrays) -> dict[Pair, Alert]:
    """When each pair was first named: in the coordinator's picture, or in an election by a UAV."""
    found: dict[Pair, Alert] = {}

    def note(pair: Pair, alert: Alert) -> None:
        if pair not in found or alert.t_ns < found[pair].t_ns:
            found[pair] = alert

    for picture in data.conflicts:
        for (a, b), ahead_s in zip(picture.pairs, picture.time_to_violation_s, strict=True):
            note((min(a, b), max(a, b)), Alert(picture.t_ns, ahead_s))
    groups: dict[tuple[int, ...], int] = {}
    for election in data.elections:
        if election.id != COORDINATOR:
            group = tuple(sorted(election.members))
            groups[group] = min(election.t_ns, groups.get(group, election.t_ns))
    for group, t_ns in groups.items():  # once, however often it was announced
        for pair in combinations(group, 2):
            note(pair, Alert(t_ns, None))
    return found
