"""The relative motion of a pair, and every time for which it was inside a volume."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.analysis import relative_motion as chords
from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.values import Incursion, Incursions, Volume
from fleet.model.types import Array


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


def chords_of(relative_m: Array, times_ns: Ints) -> Chords:
    """The chords of relative positions (times, 3), NaN where one of both is missing."""
    there = np.flatnonzero(np.isfinite(relative_m[:, 0]))
    start_m = relative_m[there]
    times_s = times_ns[there] / 1e9
    end_m = np.concatenate([start_m[1:], start_m[-1:]])
    return Chords(start_m, end_m, np.append(times_s, times_s[-1]))


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
