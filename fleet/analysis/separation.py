"""Separation of every pair of UAVs: the one account of it, of a run that is on and of its log.

Between two moments at which true states are on record the motion is taken as linear, and the least
separation is exact for that (`fleet.analysis.relative_motion`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.analysis import relative_motion as chords
from fleet.analysis.common_times import Ints
from fleet.analysis.relative_motion import Bools
from fleet.model.conflict.risk import Required
from fleet.model.conflict.zones import ALL_ALIKE, ZoneRatios
from fleet.model.types import Array, Pair
from fleet.model.units import NS_PER_S, to_s

MOST_MOMENTS, AT_ONCE = 256, 4096
"""So many moments, and so many pairs at moments, are measured at a time: few fit in the cache."""


@dataclass(frozen=True, slots=True)
class PairMinimum:
    """The moment at which a pair was nearest, by normalised separation."""

    a: int
    b: int
    least_separation: float
    horizontal_m: float
    vertical_m: float
    t_s: float

    @property
    def pair(self) -> Pair:
        """Both, the lower number first."""
        return self.a, self.b

    @property
    def lost(self) -> bool:
        """Whether they were nearer than required."""
        return self.least_separation < 1.0


class SeparationMonitor:
    """Keeps the least normalised separation of each pair, and where and when it first was.

    Of each pair it looks at a chord only if the separation turns on it: else it is least at an end.
    That is `chords.least` for all pairs, but for columns, which is several times faster. Moments
    are measured several at a time, or as soon as somebody asks.
    """

    def __init__(
        self, ids: Sequence[int], required: Required, zones: ZoneRatios = ALL_ALIKE
    ) -> None:
        """Of these UAVs; `required` is what two with the least zones require."""
        self._ids = tuple(ids)
        self._first, self._second = np.triu_indices(len(self._ids), 1)
        pairs = len(self._first)
        size_m = np.array([[required.horizontal_m, required.horizontal_m, required.vertical_m]])
        if zones.larger:
            size_m = size_m * zones.of_pairs(self._pairs())[:, [0, 0, 1]]
        self._size_m = size_m
        self._least = np.full(pairs, np.inf)
        self._place = np.zeros((pairs, 3))
        self._t_ns = np.zeros(pairs, dtype=np.int64)
        self._before = np.full((3, 1, pairs), np.nan)
        self._before_ns = 0
        self._waiting: list[tuple[int, Array]] = []
        self._at_once = min(MOST_MOMENTS, 1 + AT_ONCE // max(1, pairs))

    def update(self, t_ns: int, positions_ned_m: Array) -> None:
        """Take in true positions, shape (N, 3), in the order of the IDs; NaN: not there.

        Moments come in order of time, and the array is kept for a while.
        """
        if not len(self._first):
            return
        self._waiting.append((t_ns, positions_ned_m))
        if len(self._waiting) >= self._at_once:
            self._measure()

    def _pairs(self) -> list[Pair]:
        places = zip(self._first.tolist(), self._second.tolist(), strict=True)
        return [(self._ids[i], self._ids[j]) for i, j in places]

    def _measure(self) -> None:
        """Measure the moments that wait."""
        if not self._waiting:
            return
        times_ns, positions = zip(*self._waiting, strict=True)
        self._waiting.clear()
        unit = np.concatenate([self._before, self._relative(np.array(positions))], axis=1)
        t_ns = np.array([self._before_ns, *times_ns], dtype=np.int64)
        horizontal = np.sqrt(unit[0] ** 2 + unit[1] ** 2)
        vertical = np.abs(unit[2])
        # Row 2k is the chord to moment k, and row 2k + 1 the moment.
        values = np.full((2 * len(times_ns), len(self._first)), np.inf)
        values[1::2] = np.maximum(horizontal, vertical)[1:]
        fractions = np.zeros_like(values)
        moment, pair = self._turning(unit, horizontal >= vertical, horizontal == vertical)
        if len(moment):
            row, ends = 2 * moment, (unit[:, moment, pair].T, unit[:, moment + 1, pair].T)
            values[row, pair], fractions[row, pair] = chords.least(*ends)
        values[np.isnan(values)] = np.inf
        self._keep(values, fractions, unit, t_ns)
        self._before, self._before_ns = unit[:, -1:], times_ns[-1]

    def _relative(self, positions_ned_m: Array) -> Array:
        """Relative positions (3, moments, pairs) in units of what is required."""
        own = np.ascontiguousarray(positions_ned_m.transpose(2, 0, 1))
        unit = own.take(self._first, 2)
        unit -= own.take(self._second, 2)
        unit /= self._size_m.T[:, None]
        return unit

    def _turning(
        self, unit: Array, by_level: Bools, tied: Bools
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Moment and pair of the chords, from the moment before, on which the separation may turn.

        Shapes are those of `_measure`, with the last moment before.
        """
        before, after = unit[:, :-1], unit[:, 1:]
        step = after - before
        falls = _slope(before, step, by_level[:-1]) < 0.0
        rises = (_slope(after, step, by_level[1:]) > 0.0) | tied[1:]
        moment, pair = np.nonzero(falls & rises)
        return moment, pair

    def _keep(self, values: Array, fractions: Array, unit: Array, t_ns: Ints) -> None:
        """Take over what is lower than before, the first of equals."""
        row = values.argmin(axis=0)
        pairs = np.flatnonzero(values[row, np.arange(len(row))] < self._least)
        row = row[pairs]
        moment, on_chord = row // 2, row % 2 == 0
        start, end = unit[:, moment, pairs].T, unit[:, moment + 1, pairs].T
        fraction = fractions[row, pairs]
        spans_ns = t_ns[moment + 1] - t_ns[moment]
        between_ns = t_ns[moment] + np.rint(fraction * spans_ns)
        between = chords.along(start, end, fraction)
        self._least[pairs] = values[row, pairs]
        self._place[pairs] = np.where(on_chord[:, None], between, end)
        self._t_ns[pairs] = np.where(on_chord, between_ns, t_ns[moment + 1])

    def least(self) -> float:
        """Least normalised separation of any pair so far; inf before the first pair."""
        self._measure()
        return float(self._least.min(initial=np.inf))

    def now(self) -> float:
        """Least normalised separation of any pair at the last moment; inf without a pair."""
        self._measure()
        return float(np.fmin.reduce(chords.unit_separation(self._before[:, 0].T), initial=np.inf))

    def lost(self) -> bool:
        """Whether any pair came closer than required."""
        return self.least() < 1.0

    def pairs_lost(self) -> int:
        """How many pairs came closer than required."""
        self._measure()
        return int((self._least < 1.0).sum())

    def minima(self) -> list[PairMinimum]:
        """Every pair's minimum, nearest pair first."""
        self._measure()
        apart_m = self._place * self._size_m
        return [
            PairMinimum(
                self._ids[self._first[k]],
                self._ids[self._second[k]],
                float(self._least[k]),
                float(np.hypot(*apart_m[k, :2])),
                float(abs(apart_m[k, 2])),
                to_s(int(self._t_ns[k])),
            )
            for k in np.argsort(self._least, kind="stable")
            if np.isfinite(self._least[k])
        ]


def _slope(place: Array, step: Array, by_level: Bools) -> Array:
    """Half the rate at which the greater distance, squared, changes; of (3, moments, pairs)."""
    outwards = place[0] * step[0] + place[1] * step[1]
    slope: Array = np.where(by_level, outwards, place[2] * step[2])
    return slope


@dataclass(frozen=True)
class Nearness:
    """The minimum of every pair, nearest first; and the least separation of all over time.

    `times_ns` are the moments with two UAVs or more, and the one at which it was least.
    """

    minima: list[PairMinimum]
    times_ns: Ints
    least: Array


def nearness_of(
    ids: Sequence[int],
    times_ns: Ints,
    positions_ned_m: Array,
    required: Required,
    zones: ZoneRatios = ALL_ALIKE,
) -> Nearness:
    """How near all came to each other in a whole run, of positions (N, times, 3)."""
    monitor, now = SeparationMonitor(ids, required, zones), np.full(len(times_ns), np.inf)
    for n, t_ns in enumerate(times_ns.tolist()):
        monitor.update(t_ns, positions_ned_m[:, n])
        now[n] = monitor.now()
    minima, there = monitor.minima(), np.isfinite(now)
    times_ns, now = times_ns[there], now[there]
    if minima:
        times_ns, (now,), _ = with_minimum(times_ns, (now,), minima[0])
    return Nearness(minima, times_ns, now)


@dataclass(frozen=True)
class PairCurve:
    """How far apart two UAVs were: at each moment on record, and where they were nearest between.

    Columns of shape (n,); `nearest` is the row of the minimum. `lost` says whether separation is
    lost in a row or on the way to the next.
    """

    minimum: PairMinimum
    t_ns: Ints
    normalised: Array
    horizontal_m: Array
    vertical_m: Array
    lost: Bools
    nearest: int

    @property
    def times_s(self) -> Array:
        """The moments in s."""
        return self.t_ns / NS_PER_S


def pair_curve(
    minimum: PairMinimum, times_ns: Ints, relative_m: Array, required: Required
) -> PairCurve:
    """The curve of a pair, of relative positions (times, 3) and the minimum found before."""
    there = np.isfinite(relative_m[:, 0])
    t_ns, apart_m = times_ns[there], relative_m[there]
    unit = chords.in_zone_units(apart_m, required.horizontal_m, required.vertical_m)
    on_the_way = chords.least(unit, np.concatenate([unit[1:], unit[-1:]]))[0]
    columns = (
        chords.unit_separation(unit),
        np.hypot(apart_m[:, 0], apart_m[:, 1]),
        abs(apart_m[:, 2]),
    )
    t_ns, known, at = with_minimum(t_ns, (*columns, on_the_way), minimum)
    normalised, horizontal_m, vertical_m, on_the_way = known
    return PairCurve(minimum, t_ns, normalised, horizontal_m, vertical_m, on_the_way < 1.0, at)


def with_minimum(
    t_ns: Ints, columns: Sequence[Array], minimum: PairMinimum
) -> tuple[Ints, list[Array], int]:
    """Columns over time with a row for the minimum, where it has not one already; and which.

    The columns are normalised separation, horizontal and vertical distance, and least separation
    from then on, or the first of them.
    """
    nearest_ns = round(minimum.t_s * NS_PER_S)
    at = int(np.searchsorted(t_ns, nearest_ns))
    known = (minimum.least_separation, minimum.horizontal_m, minimum.vertical_m)
    values = (*known, minimum.least_separation)[: len(columns)]
    if at == len(t_ns) or t_ns[at] != nearest_ns:
        t_ns = np.insert(t_ns, at, nearest_ns)
        columns = [np.insert(c, at, v) for c, v in zip(columns, values, strict=True)]
    else:
        for column, value in zip(columns, values, strict=True):
            column[at] = value
    return t_ns, list(columns), at
