"""Links: what came of the messages on each, against what the fault plan lets one expect."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.data import RunArrays, Sends
from fleet.analysis.metrics.expected import (
    Pattern,
    chances,
    concerning,
    expected_latency,
    patterns_of,
)
from fleet.analysis.metrics.results import LinkMetrics, Spread
from fleet.analysis.relative_motion import Bools
from fleet.analysis.words import wilson
from fleet.faults.draws import LinkMessage
from fleet.model.equipment import hears
from fleet.model.types import COORDINATOR, Array
from fleet.protocol.classes import ADDRESSED, hears_class

DELIVERED_NAMES = ("received", "altered", "implausible")

RowIndices = NDArray[np.intp]
Link = tuple[int, int, str]
"""Source, receiver, class."""


@dataclass
class LinkCounter:
    """What is known of the messages of a link, or of several together.

    `passed` of the `settled` were delivered; `expected` is the sum of their probabilities, None if
    unknown. `patterns` counts what was delivered by the rules that delayed it.
    """

    sent: int = 0
    delivered: int = 0
    copies: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    settled: int = 0
    passed: int = 0
    expected: float | None = 0.0
    latencies_s: list[Array] = field(default_factory=list)
    patterns: Counter[Pattern] = field(default_factory=Counter)

    def add(self, other: LinkCounter) -> None:
        """Take in another link."""
        for name in ("sent", "delivered", "copies", "settled", "passed"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.dropped += other.dropped
        self.latencies_s += other.latencies_s
        self.patterns += other.patterns
        if self.expected is not None:
            self.expected = None if other.expected is None else self.expected + other.expected

    def metrics(self, kind: str, least_s: float, src: int | None, dst: int | None) -> LinkMetrics:
        """The numbers of a class of messages; nothing is delivered before `least_s`."""
        known = self.settled > 0 and self.expected is not None
        low, high = wilson(self.passed, self.settled) if self.settled else (None, None)
        return LinkMetrics(
            src,
            dst,
            kind,
            self.sent,
            self.delivered,
            self.copies,
            dict(sorted(self.dropped.items())),
            self.settled,
            self.passed / self.settled if self.settled else None,
            low,
            high,
            (self.expected or 0.0) / self.settled if known else None,
            Spread.of(np.concatenate(self.latencies_s) if self.latencies_s else ()),
            expected_latency(self.patterns, least_s),
        )


def measure_links(data: RunArrays) -> tuple[tuple[LinkMetrics, ...], tuple[LinkMetrics, ...]]:
    """By class, and by link and class; only those on which something was sent."""
    least_s = 0.0 if data.realtime else data.scenario.tick_s
    by_class: defaultdict[str, LinkCounter] = defaultdict(LinkCounter)
    links = []
    for (src, dst, kind), count in _links(data):
        by_class[kind].add(count)
        links.append(count.metrics(kind, least_s, src, dst))
    classes = tuple(by_class[kind].metrics(kind, least_s, None, None) for kind in sorted(by_class))
    return classes, tuple(links)


def _links(data: RunArrays) -> Iterator[tuple[Link, LinkCounter]]:
    """Every link that has been used, in order."""
    receipts = {node: _by_source(data, node) for node in (COORDINATOR, *data.ids)}
    for (src, kind), sends in sorted(data.sends.items()):
        for dst in _receivers(data, src, kind):
            own = _picked(sends, sends.dst == dst) if kind in ADDRESSED else sends
            if len(own.seq):
                rows = receipts[dst].get((src, kind))
                yield (src, dst, kind), _count(data, LinkMessage(src, dst, kind, 0, 0), own, rows)


def _receivers(data: RunArrays, src: int, kind: str) -> list[int]:
    """Who hears a class of messages from a source; addressed ones may be for the source itself."""
    hearing = [uav.id for uav in data.uavs if hears(uav.equipment)]
    if data.coordinated and hears_class(COORDINATOR, kind):
        hearing.insert(0, COORDINATOR)
    return [node for node in hearing if node != src or kind in ADDRESSED]


def _picked(sends: Sends, which: Bools) -> Sends:
    return Sends(sends.seq[which], sends.t_ns[which], sends.bits[which], sends.dst[which])


@dataclass(frozen=True)
class Rows:
    """Entries of delivery reports on one link: columns of shape (n,)."""

    seq: Ints
    sent_ns: Ints
    delivered_ns: Ints
    fate: Ints


def _by_source(data: RunArrays, receiver: int) -> dict[tuple[int, str], Rows]:
    """What one receiver reported, by source and class."""
    r = data.receipts.get(receiver)
    if r is None or not len(r.src):
        return {}
    order = np.lexsort((r.kind, r.src))
    edges = np.flatnonzero(np.diff(r.src[order]) | np.diff(r.kind[order])) + 1
    found = {}
    for rows in np.split(order, edges):
        key = (int(r.src[rows[0]]), data.names[int(r.kind[rows[0]])])
        found[key] = Rows(r.seq[rows], r.sent_ns[rows], r.delivered_ns[rows], r.fate[rows])
    return found


def _count(data: RunArrays, link: LinkMessage, sends: Sends, rows: Rows | None) -> LinkCounter:
    """One link. A message that came several times counts once, with its first delivery."""
    count = LinkCounter(sent=len(sends.seq))
    if rows is None:
        return count
    came = np.isin(rows.fate, [data.code(fate) for fate in DELIVERED_NAMES])
    first = _first_of_each(rows, np.flatnonzero(came))
    lost = _first_of_each(rows, np.flatnonzero(~came & ~np.isin(rows.seq, rows.seq[first])))
    count.delivered, count.copies = len(first), int(came.sum()) - len(first)
    count.dropped = Counter(data.names[fate] for fate in rows.fate[lost].tolist())
    latencies_ns = rows.delivered_ns[first] - rows.sent_ns[first]
    count.latencies_s = [latencies_ns / 1e9]
    rules = concerning(data.plan, link)
    count.patterns = patterns_of(rules, rows.sent_ns[first])
    # What is lost is known at once, what is delivered not before it comes: of what was sent in the
    # last moments only the losses are known.
    until_ns = data.end_ns - int(latencies_ns.max(initial=0))
    passed, failed = (rows.seq[r[rows.sent_ns[r] <= until_ns]] for r in (first, lost))
    settled = _picked(sends, np.isin(sends.seq, np.concatenate([passed, failed])))
    count.passed, count.settled = len(passed), len(passed) + len(failed)
    probable = chances(
        rules, link, settled.t_ns, settled.bits, lambda: _distances_m(data, link, settled.t_ns)
    )
    count.expected = None if probable is None else float(probable.sum())
    return count


def _first_of_each(rows: Rows, picked: RowIndices) -> RowIndices:
    """Of these rows the one delivered first of each message."""
    order = picked[np.lexsort((rows.delivered_ns[picked], rows.seq[picked]))]
    _, first = np.unique(rows.seq[order], return_index=True)
    return order[first]


def _distances_m(data: RunArrays, link: LinkMessage, t_ns: Ints) -> Array:
    """Distance of sender and receiver when messages were sent, shape (n,); NaN where unknown."""
    if not len(data.times_ns):
        return np.full(len(t_ns), np.nan)
    ticks = np.minimum(np.searchsorted(data.times_ns, t_ns), len(data.times_ns) - 1)
    apart = _places(data, link.src, ticks) - _places(data, link.dst, ticks)
    distances: Array = np.sqrt(np.sum(apart * apart, axis=1))
    return distances


def _places(data: RunArrays, node: int, ticks: RowIndices) -> Array:
    if node == COORDINATOR:
        return np.tile(data.scenario.coordination.position_ned_m, (len(ticks), 1))
    places: Array = data.positions_ned_m[data.ids.index(node), ticks]
    return places
