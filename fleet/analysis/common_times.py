"""True states brought to common moments: where everybody was when anybody is on record.

Where a UAV has a gap its motion is taken as linear from the state before to the one after. Before
its first state and after its last one it is not there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import Array, Position

Ints = NDArray[np.int64]
"""A position, north, east, down in m."""
PositionsById = Mapping[int, Position]
"""Where one UAV was, by time in ns."""
NOWHERE = (np.nan, np.nan, np.nan)

HELD_NS = 5_000_000_000
"""True states that come as they are sent are waited for so long, behind the newest one."""


def positions_of(
    ids: Sequence[int], flown: Mapping[int, Mapping[int, Position]]
) -> tuple[Ints, Array]:
    """The times of all true states, and where each UAV was then, (N, times, 3); NaN: not there.

    `flown` has places by UAV and time in ns.
    """
    times = np.array(sorted({t for own in flown.values() for t in own}), dtype=np.int64)
    out = np.full((len(ids), len(times), 3), np.nan)
    for n, uav in enumerate(ids):
        own = sorted(flown.get(uav, {}).items())
        if own:
            at = np.array([t for t, _ in own], dtype=np.int64)
            there = (times >= at[0]) & (times <= at[-1])
            out[n, there] = _between(times[there], at, np.array([place for _, place in own]))
    return times, out


def _between(times: Ints, at: Ints, places: Array) -> Array:
    """Places (n, 3) at these times, on straight lines between the known ones."""
    return np.stack([np.interp(times, at, places[:, axis]) for axis in range(3)], axis=1)


class CommonTimes:
    """The same, while a run is on: true states in any order in, moments in order of time out."""

    def __init__(self, ids: Sequence[int]) -> None:
        self._place = {uav: n for n, uav in enumerate(ids)}
        self._waiting: list[dict[int, Position]] = [{} for _ in ids]
        self._before: list[tuple[int, Position] | None] = [None for _ in ids]
        self._times: set[int] = set()
        self._done_ns = -1

    def add(self, uav: int, t_ns: int, place: Position) -> None:
        """Take in a true state; of two of a moment the last one counts, of strangers none."""
        if uav in self._place and t_ns > self._done_ns:
            self._waiting[self._place[uav]][t_ns] = place
            self._times.add(t_ns)

    def settled_ns(self, vanished: frozenset[int]) -> int:
        """Up to when nothing more is to come, given that each UAV reports in order of time.

        Unless it has vanished, the last state of every UAV is waited for, and some time beyond.
        """
        limit_ns = max(self._times, default=-1) - HELD_NS
        if limit_ns < min(self._times, default=0):
            return -1  # nothing has waited for so long, as always in lockstep
        for uav, n in self._place.items():
            if limit_ns >= 0 and uav not in vanished:
                limit_ns = min(limit_ns, max(self._waiting[n], default=-1))
        return limit_ns

    def until(self, t_ns: int) -> Iterator[tuple[int, Array]]:
        """Hand out what is not after this time: times, and positions (N, 3)."""
        for now_ns in sorted(t for t in self._times if t <= t_ns):
            self._times.discard(now_ns)
            self._done_ns = now_ns
            yield now_ns, np.array([self._at(n, now_ns) for n in range(len(self._waiting))])

    def rest(self) -> Iterator[tuple[int, Array]]:
        """Hand out all that is left: the run is over."""
        return self.until(max(self._times, default=-1))

    def _at(self, n: int, t_ns: int) -> Position:
        """Where a UAV was, from what is on record just before and after."""
        waiting = self._waiting[n]
        if t_ns in waiting:
            place = waiting.pop(t_ns)
            self._before[n] = (t_ns, place)
            return place
        before, after_ns = self._before[n], min((t for t in waiting if t > t_ns), default=None)
        if before is None or after_ns is None:
            return NOWHERE
        at = np.array([before[0], after_ns], dtype=np.int64)
        known = np.array([before[1], waiting[after_ns]])
        north, east, down = _between(np.array([t_ns], dtype=np.int64), at, known)[0].tolist()
        return north, east, down
