"""Every pair of UAVs: nearest approach, incursions into volumes, and the alerts before them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fleet.analysis import relative_motion as chords
from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.data import RunArrays
from fleet.analysis.metrics.leadership import Leadership
from fleet.analysis.metrics.results import Incursion, Incursions, PairMetrics, Volume
from fleet.analysis.separation import PairMinimum, nearness_of
from fleet.model.types import COORDINATOR, Array, Pair
from fleet.model.units import to_s


@dataclass(frozen=True)
class Alert:
    """The first time that a pair was named as being in conflict, and what was then foreseen."""

    t_ns: int
    time_to_violation_s: float | None


@dataclass(frozen=True)
class Chords:
    """The relative motion of a pair while both are on record, one row from tick to tick.

    `start_m` and `end_m` have shape (n, 3); the last row is the last moment alone. `times_s` has
    the begin of each, and of the last once more, shape (n + 1,).
    """

    start_m: Array
    end_m: Array
    times_s: Array

    def at(self, row: int, fraction: float) -> float:
        """The time of a point on a chord, in s."""
        begin, end = self.times_s[row], self.times_s[row + 1]
        return float(begin + fraction * (end - begin))

    def scaled(self, volume: Volume) -> tuple[Array, Array]:
        """Both ends in units of a volume."""
        size = volume.horizontal_m, volume.vertical_m
        return chords.in_zone_units(self.start_m, *size), chords.in_zone_units(self.end_m, *size)


def measure_pairs(
    data: RunArrays, required: Volume, volumes: Sequence[Volume], leadership: Leadership
) -> tuple[PairMetrics, ...]:
    """All pairs that were on record at the same time, nearest first."""
    alerts, place = first_alerts(data), {uav: n for n, uav in enumerate(data.ids)}
    zone, found = data.scenario.required(), []
    near = nearness_of(data.ids, data.times_ns, data.positions_ned_m, zone)
    for least in near.minima:
        pair = (least.a, least.b)
        relative_m = data.positions_ned_m[place[least.a]] - data.positions_ned_m[place[least.b]]
        path = chords_of(relative_m, data.times_ns)
        held = tuple(incursions(path, volume) for volume in (required, *volumes))
        found.append(_pair(least, path, held, alerts.get(pair), leadership))
    return tuple(found)


def chords_of(relative_m: Array, times_ns: Ints) -> Chords:
    """The chords of relative positions (times, 3), NaN where one of both is missing."""
    there = np.flatnonzero(np.isfinite(relative_m[:, 0]))
    start_m = relative_m[there]
    times_s = times_ns[there] / 1e9
    end_m = np.concatenate([start_m[1:], start_m[-1:]])
    return Chords(start_m, end_m, np.append(times_s, times_s[-1]))


def _pair(
    least: PairMinimum,
    path: Chords,
    held: tuple[Incursions, ...],
    alert: Alert | None,
    leadership: Leadership,
) -> PairMetrics:
    fraction = chords.closest(path.start_m, path.end_m)
    points = chords.along(path.start_m, path.end_m, fraction)
    distances = np.sqrt(np.sum(points * points, axis=1))
    row = int(np.argmin(distances))
    losses = held[0]
    lead_s = None
    if alert is not None and losses.first_s is not None:
        lead_s = losses.first_s - to_s(alert.t_ns)
    pair = (least.a, least.b)
    at_risk_s, without_s = leadership.of_pair(pair)
    return PairMetrics(
        least.a,
        least.b,
        least.least_separation,
        least.horizontal_m,
        least.vertical_m,
        least.t_s,
        float(distances[row]),
        path.at(row, float(fraction[row])),
        *_apart(points[row]),
        losses,
        held[1:],
        to_s(alert.t_ns) if alert else None,
        alert.time_to_violation_s if alert else None,
        leadership.time_to_violation_s(pair, alert.t_ns) if alert else None,
        lead_s,
        at_risk_s,
        without_s,
    )


def _apart(relative_m: Array) -> tuple[float, float]:
    """Horizontal and vertical distance of a relative position (3,)."""
    return float(np.hypot(relative_m[0], relative_m[1])), float(abs(relative_m[2]))


def incursions(path: Chords, volume: Volume) -> Incursions:
    """Every time for which a pair was inside a volume: horizontally and vertically too near."""
    start, end = path.scaled(volume)
    rows = np.flatnonzero(chords.bound(start, end) < 1.0 + chords.ROUNDING)
    enter, leave = chords.inside(start[rows], end[rows])
    values, lowest = chords.least(start[rows], end[rows])
    events: list[Incursion] = []
    last_row, open_ended = -2, False
    brief = np.isnan(enter)  # so short that rounding hides it
    enter, leave = np.where(brief, lowest, enter), np.where(brief, lowest, leave)
    for k in np.flatnonzero(values < 1.0):
        row, severity = int(rows[k]), float(1.0 - values[k])
        end_s = path.at(row, float(leave[k]))
        if open_ended and row == last_row + 1 and enter[k] == 0.0:
            before = events.pop()
            events.append(Incursion(before.start_s, end_s, max(before.severity, severity)))
        else:
            events.append(Incursion(path.at(row, float(enter[k])), end_s, severity))
        last_row, open_ended = row, leave[k] == 1.0
    return Incursions(
        volume.name,
        len(events),
        math.fsum(e.end_s - e.start_s for e in events),
        max((e.severity for e in events), default=0.0),
        events[0].start_s if events else None,
        tuple(events),
    )


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
