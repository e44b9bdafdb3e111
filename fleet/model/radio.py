"""Radio range: who hears what is sent in a tick, by where all radios are.

A message is heard where the true distance of the two radios is within the radio range of their link
at the end of the tick in which it is sent. Pairs are found in a grid, so that the time grows with
the number of neighbours and not with the square of the fleet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.model.elementary import dist
from fleet.model.types import COORDINATOR, Array, Indices, Position

FEW_LINKS = 4096
"""Of so many pairs each is looked at: that is the fastest up to there."""
LEAST_SQUARE_M = 1.0
"""The grid has no smaller squares: their numbers stay small integers."""
SPARE = 1.001
"""Squares are larger than the range by so much: no rounding puts a pair two squares apart."""


@dataclass(frozen=True, slots=True)
class RadioRange:
    """How far radios reach, in m; None: everywhere.

    `uavs_m` is the range between two UAVs, `coordinator_m` that between a UAV and the coordinator.
    `margin_m` is how far a UAV can fly within the time for which it listens ahead.
    """

    uavs_m: float | None = None
    coordinator_m: float | None = None
    margin_m: float = 0.0

    @property
    def limited(self) -> bool:
        """Whether anybody can be out of range."""
        return self.uavs_m is not None or self.coordinator_m is not None

    def changed(self, by_m: float) -> RadioRange:
        """The same with limits that are further, or with a negative number nearer."""
        uavs_m, coordinator_m = (
            None if limit is None else max(0.0, limit + by_m)
            for limit in (self.uavs_m, self.coordinator_m)
        )
        return RadioRange(uavs_m, coordinator_m, self.margin_m)

    def reaches(self, src: int, dst: int, there: Position | None, here: Position) -> bool:
        """Whether a radio `here` hears one `there`; one whose place is not known is not heard.

        What somebody sends to itself needs no radio.
        """
        range_m = self.coordinator_m if COORDINATOR in (src, dst) else self.uavs_m
        if range_m is None or src == dst:
            return True
        return there is not None and within(there, here, range_m)


def within(there: Sequence[float], here: Sequence[float], range_m: float) -> bool:
    """Whether two points are no further apart; by the same bits as `pairs_within`."""
    north, east, down = (a - b for a, b in zip(there, here, strict=True))
    return north * north + east * east + down * down <= range_m * range_m


class Ear:
    """From where a participant listens.

    That is where it is at the end of its last step. Unless it has come further since the one before
    than its margin, as when it has been stopped meanwhile: then it listens from there for a tick
    yet. So who subscribes ahead, by as much, never misses anything.
    """

    def __init__(self, place: Position) -> None:
        self.place = self.last = place

    def move(self, place: Position, margin_m: float) -> None:
        """Its participant has made a step, and is here now."""
        near = dist(self.last, place) <= margin_m
        self.place, self.last = place if near else self.last, place


class Earshot:
    """Who hears what is sent in one tick."""

    def __init__(
        self, radio: RadioRange, sending: Mapping[int, Position], ears: Mapping[int, Position]
    ) -> None:
        """`sending` has the places of those who send, `ears` from where all listen, by number."""
        self._radio = radio
        self._uavs = [n for n in ears if n != COORDINATOR]
        self._place = ears.get(COORDINATOR)
        self._sending, self._ears = sending, ears
        self._near: dict[int, list[int]] | None = None
        if radio.uavs_m is not None:
            sources = [n for n in sending if n != COORDINATOR]
            pairs = pairs_within(
                _rows(sending[n] for n in sources), _rows(ears[n] for n in self._uavs), radio.uavs_m
            )
            self._near = {n: [] for n in sources}
            for first, second in zip(*(p.tolist() for p in pairs), strict=True):
                self._near[sources[first]].append(self._uavs[second])

    def hearers(self, src: int) -> Sequence[int]:
        """Who hears what somebody sends to all, the coordinator included; never itself."""
        if src == COORDINATOR:
            return [uav for uav in self._uavs if self.hears(src, uav)]
        near = self._uavs if self._near is None else self._near.get(src, [])
        heard = [uav for uav in near if uav != src]
        if self._place is not None and self.hears(src, COORDINATOR):
            heard.append(COORDINATOR)
        return heard

    def hears(self, src: int, dst: int) -> bool:
        """Whether one hears the other; oneself always, who is not there never."""
        there, here = self._sending.get(src), self._ears.get(dst)
        return here is not None and self._radio.reaches(src, dst, there, here)


def pairs_within(there: Array, here: Array, range_m: float) -> tuple[Indices, Indices]:
    """Indices (i, j) of the points `there` (S, 3) and `here` (R, 3) that are no further apart.

    In order of i, then j. Points that are not known (NaN) are in no pair.
    """
    if len(there) * len(here) <= FEW_LINKS:
        first = np.repeat(np.arange(len(there)), len(here))
        second = np.tile(np.arange(len(here)), len(there))
    else:
        first, second = _neighbours(there, here, max(SPARE * range_m, LEAST_SQUARE_M))
    apart = there[first] - here[second]
    north, east, down = apart[:, 0], apart[:, 1], apart[:, 2]
    near = north * north + east * east + down * down <= range_m * range_m
    first, second = first[near], second[near]
    order = np.lexsort((second, first))
    return first[order], second[order]


def _neighbours(there: Array, here: Array, size_m: float) -> tuple[Indices, Indices]:
    """Each pair of which both are in one square, or in two neighbouring ones, of a grid."""
    sources, listeners = _known(there), _known(here)
    if not len(sources) or not len(listeners):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    low = np.minimum(there[sources].min(axis=0), here[listeners].min(axis=0))[:2]
    rows, columns = _squares(there[sources], low, size_m).T
    row, column = _squares(here[listeners], low, size_m).T
    width = int(max(columns.max(), column.max())) + 2  # a square to spare: rows do not touch
    keys = row * width + column
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    found = []
    for step in (-1, 0, 1):
        middle = (rows + step) * width + columns
        begin = np.searchsorted(keys, middle - 1, "left")
        end = np.searchsorted(keys, middle + 1, "right")
        found.append(_spans(begin, end))
    first = np.concatenate([sources[one] for one, _ in found])
    second = np.concatenate([listeners[order[other]] for _, other in found])
    return first, second


def _known(places: Array) -> Indices:
    return np.flatnonzero(np.isfinite(places).all(axis=1))


def _squares(places: Array, low: Array, size_m: float) -> NDArray[np.int64]:
    return np.floor((places[:, :2] - low) / size_m).astype(np.int64)


def _spans(begin: Indices, end: Indices) -> tuple[Indices, Indices]:
    """Each index k with all of `begin[k]` to `end[k]`, the end excluded."""
    counts = end - begin
    each = np.repeat(np.arange(len(counts)), counts)
    before = np.add.accumulate(counts) - counts
    return each, np.arange(len(each)) + np.repeat(begin - before, counts)


def _rows(places: Iterable[Position]) -> Array:
    return np.array(list(places), dtype=np.float64).reshape(-1, 3)
