"""How far the wall clocks of a realtime run are apart, estimated on each link from both directions.

As NTP does it: a message tells when it was published by its sender's clock, and its receiver when
it arrived by its own. What that comes to is the way plus the offset of the clocks, and in the other
direction another way minus the same offset. Half the difference of the least of each is the offset,
off by half the difference of the two ways at most. How the round trip is shared between them nobody
can tell from its ends, so half of it is the uncertainty.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from msgspec import Struct

from fleet.model.types import COORDINATOR
from fleet.model.units import to_s
from fleet.protocol.messages import DeliveryReport

WINDOW_NS = 10_000_000_000
"""A clock may be set or drift: estimates are of so much of a run (by the participants' time)."""
WARNED_FRACTION, DEGRADED_FRACTION = 0.1, 1.0
"""Of a tick: clocks that are further apart than this are told of, or make a run degraded."""


class ClockOffset(Struct, frozen=True, gc=False):
    """By how much one clock is ahead of another, and by how much that may be wrong; in ns."""

    offset_ns: int
    uncertainty_ns: int

    @property
    def surely_ns(self) -> int:
        """So far the clocks are apart at least; negative if they may be together."""
        return abs(self.offset_ns) - self.uncertainty_ns

    def exceeds(self, limit_ns: float) -> bool:
        """Whether the clocks differ, and by more than a limit."""
        return self.surely_ns > 0 and abs(self.offset_ns) > limit_ns


NO_OFFSET = ClockOffset(0, 0)
SIMULATION_CLOCK = -(2**63)
"""Stands for the simulation where clocks are told by the number of a participant."""


def offset_between(there_ns: int, back_ns: int) -> ClockOffset:
    """The offset of b's clock over a's, of the least transits from a to b and back (ns).

    Each is as measured, from publication by one clock to arrival by the other: nothing is clamped.
    A round trip below 0 tells that a clock was set meanwhile, by about so much.
    """
    round_trip_ns = there_ns + back_ns
    return ClockOffset((there_ns - back_ns) // 2, (abs(round_trip_ns) + 1) // 2)


@dataclass
class PairOfClocks:
    """The offset of the clock of the pair's second over that of its first, window by window."""

    _window: int = 0
    _least: list[int | None] = field(default_factory=lambda: [None, None])
    _before: list[int | None] = field(default_factory=lambda: [None, None])
    _surest: ClockOffset | None = None

    def add(self, direction: int, t_ns: int, transit_ns: int) -> None:
        """A message came at `t_ns`; direction 0 is from the first to the second."""
        window = t_ns // WINDOW_NS
        if window > self._window:
            self._begin(window)
        least = self._least if window == self._window else self._before
        known = least[direction]
        if known is None or transit_ns < known:
            least[direction] = transit_ns

    def _begin(self, window: int) -> None:
        self._surest = _surer(self._surest, _estimate(self._before))
        if window > self._window + 1:
            self._surest = _surer(self._surest, _estimate(self._least))
            self._least = [None, None]
        self._before, self._least, self._window = self._least, [None, None], window

    @property
    def latest(self) -> ClockOffset | None:
        """What is known now; None while messages have come in one direction alone."""
        return _estimate(self._least) or _estimate(self._before)

    @property
    def surest(self) -> ClockOffset | None:
        """Of all windows so far that in which the clocks were furthest apart for certain."""
        return _surer(_surer(self._surest, _estimate(self._before)), _estimate(self._least))


def _estimate(least: list[int | None]) -> ClockOffset | None:
    there_ns, back_ns = least
    return None if there_ns is None or back_ns is None else offset_between(there_ns, back_ns)


def _surer(one: ClockOffset | None, other: ClockOffset | None) -> ClockOffset | None:
    if one is None or other is None:
        return one or other
    return max(one, other, key=lambda o: o.surely_ns)


@dataclass(frozen=True)
class ClockAccount:
    """What is known of the clocks of a run.

    `reference` is the participant whose clock is the median (None: nothing was measured), `offsets`
    by how much the others are ahead of it. `one_way` counts links whose other direction was never
    heard; of the clocks of the `unknown` nothing is known. `apart` is how far two clocks are apart
    that are furthest from each other for certain. The simulation has its place among the
    `offsets` as `SIMULATION_CLOCK`, and is no reference.
    """

    reference: int | None
    offsets: Mapping[int, ClockOffset]
    one_way: int
    unknown: tuple[int, ...]
    apart: ClockOffset | None
    tick_ns: int

    @property
    def warned(self) -> bool:
        """Two clocks differ by more than a tenth of a tick."""
        return self.apart is not None and self.apart.exceeds(WARNED_FRACTION * self.tick_ns)

    @property
    def degraded(self) -> bool:
        """Two clocks differ by more than a tick."""
        return self.apart is not None and self.apart.exceeds(DEGRADED_FRACTION * self.tick_ns)

    def at_most_ahead_ns(self, one: int, other: int) -> int:
        """By how much at most the clock of one participant is ahead of another's, as far as known.

        What is within its uncertainty counts as no offset at all.
        """
        a, b = (self.offsets.get(number, NO_OFFSET) for number in (one, other))
        between = ClockOffset(a.offset_ns - b.offset_ns, a.uncertainty_ns + b.uncertainty_ns)
        certain = between.surely_ns > 0
        return between.offset_ns + between.uncertainty_ns if certain else 0

    def record(self) -> dict[str, Any]:
        """For programs; times in s."""
        rows = [
            {
                "id": number,
                "offset_s": to_s(offset.offset_ns),
                "uncertainty_s": to_s(offset.uncertainty_ns),
            }
            for number, offset in sorted(self.offsets.items())
        ]
        own = [row for row in rows if row["id"] == SIMULATION_CLOCK]
        return {
            "reference": self.reference,
            "offsets": [row for row in rows if row not in own],
            "simulation": own[0] if own else None,
            "one_way": self.one_way,
            "unknown": self.unknown,
            "warned": self.warned,
            "degraded": self.degraded,
            "words": self.words(),
        }

    def words(self) -> str:
        """Whose clock is wrong by how much, as `clock of UAV 1: 0.500 s ahead (+-0.2 ms)`."""
        limit_ns = WARNED_FRACTION * self.tick_ns
        wrong = [(n, o) for n, o in sorted(self.offsets.items()) if o.exceeds(limit_ns)]
        return "; ".join(f"clock of {_name(n)}: {offset_words(o)}" for n, o in wrong)


def offset_words(offset: ClockOffset) -> str:
    """As in `0.5002 s ahead (+-0.4 ms)`."""
    side = "ahead" if offset.offset_ns >= 0 else "behind"
    away_s, half_ms = abs(offset.offset_ns) / 1e9, offset.uncertainty_ns / 1e6
    return f"{away_s:.4g} s {side} (+-{half_ms:.2g} ms)"


def _name(number: int) -> str:
    if number == SIMULATION_CLOCK:
        return "the simulation"
    return "the coordinator" if number == COORDINATOR else f"UAV {number}"


@dataclass
class ClockOffsets:
    """Fed what receivers measured of each message of a run; tells whose clock is how wrong.

    `numbers` are all who take part.
    """

    tick_ns: int = 0
    numbers: frozenset[int] = frozenset()
    _pairs: dict[tuple[int, int], PairOfClocks] = field(
        default_factory=lambda: defaultdict(PairOfClocks)
    )

    def add(self, src: int, dst: int, t_ns: int, transit_ns: int) -> None:
        """A message from `src` came to `dst`, which was at `t_ns` of the run."""
        pair, direction = ((src, dst), 0) if src < dst else ((dst, src), 1)
        self._pairs[pair].add(direction, t_ns, transit_ns)

    def add_answer(self, number: int, t_ns: int, asked_ns: int, told_ns: int, came_ns: int) -> None:
        """The simulation asked a participant for its time: when, what it told, when that came.

        `t_ns` is the time of the run; the others are Unix time by the clock of who measured it.
        """
        self.add(SIMULATION_CLOCK, number, t_ns, told_ns - asked_ns)
        self.add(number, SIMULATION_CLOCK, t_ns, came_ns - told_ns)

    def add_report(self, report: DeliveryReport) -> None:
        """All that a participant measured in one step."""
        for src, transit_ns in zip(report.src, report.transit_ns, strict=bool(report.transit_ns)):
            if transit_ns and src != report.id:
                self.add(src, report.id, report.t_ns, transit_ns)

    def correction_ns(self, src: int, dst: int) -> int | None:
        """What of a transit from `src` to `dst` is the clocks' offset; None if not known yet."""
        pair = self._pairs.get((min(src, dst), max(src, dst)))
        latest = pair.latest if pair else None
        if latest is None:
            return None
        return latest.offset_ns if src < dst else -latest.offset_ns

    def account(self) -> ClockAccount:
        """What is known by now."""
        found = {pair: clocks.surest for pair, clocks in self._pairs.items()}
        known = {pair: offset for pair, offset in found.items() if offset is not None}
        reference, offsets = _over_median(known)
        apart = max(known.values(), key=lambda o: o.surely_ns, default=None)
        unknown = tuple(sorted(self.numbers - offsets.keys()))
        one_way = len(found) - len(known)
        return ClockAccount(reference, offsets, one_way, unknown, apart, self.tick_ns)


def _over_median(
    pairs: Mapping[tuple[int, int], ClockOffset],
) -> tuple[int | None, dict[int, ClockOffset]]:
    """Whose clock is the median, and the offsets of all that links connect with it, over it.

    Of parts of a fleet that never heard each other it is the largest.
    """
    neighbours = defaultdict[int, list[tuple[int, ClockOffset]]](list)
    for (a, b), offset in pairs.items():
        neighbours[a].append((b, offset))
        neighbours[b].append((a, ClockOffset(-offset.offset_ns, offset.uncertainty_ns)))
    parts, seen = list[dict[int, ClockOffset]](), set[int]()
    for number in sorted(neighbours):
        if number not in seen:
            parts.append(_surest_ways(number, neighbours))
            seen |= parts[-1].keys()
    if not parts:
        return None, {}
    part = max(parts, key=len)
    taking_part = (n for n in part if n != SIMULATION_CLOCK)
    in_order = sorted(taking_part, key=lambda n: (part[n].offset_ns, n))
    reference = in_order[(len(in_order) - 1) // 2]
    return reference, _surest_ways(reference, neighbours)


def _surest_ways(
    start: int, neighbours: Mapping[int, Iterable[tuple[int, ClockOffset]]]
) -> dict[int, ClockOffset]:
    """Offsets over one clock, each by the way on which the uncertainties add up to least."""
    found, waiting = dict[int, ClockOffset](), [(0, start, 0)]
    while waiting:
        uncertainty_ns, number, offset_ns = heapq.heappop(waiting)
        if number in found:
            continue
        found[number] = ClockOffset(offset_ns, uncertainty_ns)
        for other, step in neighbours.get(number, ()):
            if other not in found:
                further_ns = uncertainty_ns + step.uncertainty_ns
                heapq.heappush(waiting, (further_ns, other, offset_ns + step.offset_ns))
    return found
