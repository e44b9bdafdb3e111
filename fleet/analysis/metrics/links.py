"""Links: what came of the messages on each, against what the fault plan lets one expect."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.common_times import Ints
from fleet.analysis.earshots import Earshots
from fleet.analysis.metrics.data import RunArrays, Sends
from fleet.analysis.metrics.definition import Compared, MetricOf, MetricRow, Shown, metric_row
from fleet.analysis.metrics.expected import (
    Pattern,
    chances,
    concerning,
    expected_latency,
    patterns_of,
)
from fleet.analysis.metrics.values import Spread
from fleet.analysis.relative_motion import Bools
from fleet.analysis.words import wilson
from fleet.faults.draws import LinkMessage
from fleet.model.equipment import hears
from fleet.model.types import COORDINATOR, Array
from fleet.model.words import ArrivalFate
from fleet.protocol.classes import ADDRESSED, hears_class

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


@dataclass(frozen=True)
class LinkOnRecord:
    """A link and a class of messages: what its metrics are computed from.

    `src` and `dst` are None of all links together.
    """

    data: RunArrays
    kind: str
    count: LinkCounter
    src: int | None = None
    dst: int | None = None

    @property
    def least_s(self) -> float:
        """The least latency there is: a tick in lockstep."""
        return 0.0 if self.data.realtime else self.data.scenario.tick_s

    @property
    def latencies_s(self) -> Array:
        """Latencies of what was delivered, shape (n,)."""
        return np.concatenate([*self.count.latencies_s, np.zeros(0)])

    def share(self, number: float | None) -> float | None:
        """Of the settled messages."""
        return None if number is None or not self.count.settled else number / self.count.settled

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Where the delivery ratio is with 95 % confidence."""
        settled = self.count.settled
        return wilson(self.count.passed, settled) if settled else (None, None)


def _ratio_text(row: LinkMetrics) -> str:
    if row.delivery_ratio is None:
        return "-"
    return f"{row.delivery_ratio:.3f}\n{row.delivery_low:.3f}-{row.delivery_high:.3f}"


link_metric = MetricOf[LinkOnRecord]()


@metric_row
class LinkMetrics(MetricRow[LinkOnRecord]):
    """One directed link (0 is the coordinator), or all together (None), and a class of messages."""

    src: int | None = link_metric(
        "-",
        "the sender, 0 the coordinator; blank for all links together",
        lambda link: link.src,
        source="-",
    )
    dst: int | None = link_metric("-", "the receiver", lambda link: link.dst, source="-")
    kind: str = link_metric(
        "-",
        "the class of messages",
        lambda link: link.kind,
        source="docs/protocol",
    )
    sent: int = link_metric(
        "1",
        "messages sent on the link, within radio range if there is one",
        lambda link: link.count.sent,
        shown=Shown("sent"),
    )
    delivered: int = link_metric(
        "1",
        "messages that the receiver reports as received, altered or implausible",
        lambda link: link.count.delivered,
        source="docs/protocol, Delivery",
        shown=Shown("came"),
    )
    copies: int = link_metric(
        "1",
        "further deliveries of the same messages",
        lambda link: link.count.copies,
    )
    dropped: dict[str, int] = link_metric(
        "1",
        "messages that were not delivered, by the fault that kept them away",
        lambda link: dict(sorted(link.count.dropped.items())),
        source="docs/protocol, Delivery",
    )
    settled: int = link_metric(
        "1",
        "messages that the ratios are about: their fate is on record, and they were sent no "
        "later than the longest latency of the link before the end. (Of later ones only the "
        "losses are known.) What is missing was in flight, or for a process that was dead",
        lambda link: link.count.settled,
        symbol="n",
        shown=Shown("settled"),
    )
    delivery_ratio: float | None = link_metric(
        "1",
        "delivered of the settled / settled",
        lambda link: link.share(link.count.passed),
        symbol="p",
        source="packet delivery ratio",
        shown=Shown("ratio, 95 %", _ratio_text),
        compared=Compared(),
    )
    delivery_low: float | None = link_metric(
        "1",
        "lower end of its 95 % interval, as if messages were lost independently",
        lambda link: link.interval[0],
        source="Wilson, 1927",
    )
    delivery_high: float | None = link_metric(
        "1",
        "upper end of it",
        lambda link: link.interval[1],
        source="Wilson, 1927",
    )
    expected_ratio: float | None = link_metric(
        "1",
        "mean over the settled messages of the probability that the plan lets them pass",
        lambda link: link.share(link.count.expected),
        symbol="E[p]",
        source="[below](#expected)",
        shown=Shown("plan"),
        compared=Compared(),
    )
    latency_s: Spread = link_metric(
        "s",
        "[Spread](#spread) of delivery - sending, of the first delivery of each message. In "
        "realtime an answer is dated when the command came, but leaves with the next step: up "
        "to a tick is in its latency",
        lambda link: Spread.of(link.latencies_s),
        shown=Shown("mean s"),
    )
    expected_latency_s: Spread = link_metric(
        "s",
        "[Spread](#spread) of what the plan makes of the delivered messages",
        lambda link: expected_latency(link.count.patterns, link.least_s),
        source="[below](#expected)",
        shown=Shown("plan"),
    )


def measure_links(data: RunArrays) -> tuple[tuple[LinkMetrics, ...], tuple[LinkMetrics, ...]]:
    """By class, and by link and class; only those on which something was sent within range."""
    by_class: defaultdict[str, LinkCounter] = defaultdict(LinkCounter)
    links = []
    for (src, dst, kind), count in _links(data):
        by_class[kind].add(count)
        links.append(LinkMetrics.of(LinkOnRecord(data, kind, count, src, dst)))
    classes = [LinkMetrics.of(LinkOnRecord(data, k, by_class[k])) for k in sorted(by_class)]
    return tuple(classes), tuple(links)


def _links(data: RunArrays) -> Iterator[tuple[Link, LinkCounter]]:
    """Every link that has been used, in order."""
    receipts = {node: _by_source(data, node) for node in (COORDINATOR, *data.ids)}
    limited = data.scenario.radio().limited
    reached = _within_range(data, receipts) if limited else {}
    for (src, kind), sends in sorted(data.sends.items()):
        for dst in sorted(reached[src, kind]) if limited else _receivers(data, src, kind):
            own = sends
            if limited:
                own = _picked(sends, np.isin(sends.seq, reached[src, kind][dst]))
            elif kind in ADDRESSED:
                own = _picked(sends, sends.dst == dst)
            if len(own.seq):
                rows = receipts[dst].get((src, kind))
                yield (src, dst, kind), _count(data, LinkMessage(src, dst, kind, 0, 0), own, rows)


def _receivers(data: RunArrays, src: int, kind: str) -> list[int]:
    """Who hears a class of messages from a source; addressed ones may be for the source itself."""
    return [node for node in _hearing(data, kind) if node != src or kind in ADDRESSED]


def _hearing(data: RunArrays, kind: str) -> list[int]:
    """Who hears a class of messages at all, in order."""
    hearing = [uav.id for uav in data.uavs if hears(uav.equipment)]
    if data.coordinated and hears_class(COORDINATOR, kind):
        hearing.insert(0, COORDINATOR)
    return hearing


Reached = dict[tuple[int, str], defaultdict[int, list[int]]]
"""By source and class, then by receiver: the sequence numbers of what was within its range."""


def _within_range(data: RunArrays, receipts: dict[int, RowsBySource]) -> Reached:
    """With a radio range, what was within it; and in any case what has been reported."""
    truths = (truth for own in data.truths.values() for truth in own.values())
    earshots = Earshots(data.scenario, truths)
    hearing = {kind: {*_hearing(data, kind)} for _, kind in data.sends}
    out: Reached = {key: defaultdict(list) for key in data.sends}
    for node, sources in receipts.items():
        for key, rows in sources.items():
            if key in out:
                out[key][node] += rows.seq.tolist()
    sent = [
        (t_ns, src, kind, seq, dst)
        for (src, kind), s in data.sends.items()
        for t_ns, seq, dst in zip(s.t_ns.tolist(), s.seq.tolist(), s.dst.tolist(), strict=True)
    ]
    for t_ns, src, kind, seq, dst in sorted(sent):
        hearers: Sequence[int] = earshots.hearers(src, t_ns) if kind not in ADDRESSED else ()
        if kind in ADDRESSED and earshots.hears(src, dst, t_ns):
            hearers = (dst,)
        for hearer in hearers:
            if hearer in hearing[kind]:
                out[src, kind][hearer].append(seq)
    return out


def _picked(sends: Sends, which: Bools) -> Sends:
    return Sends(sends.seq[which], sends.t_ns[which], sends.bits[which], sends.dst[which])


@dataclass(frozen=True)
class Rows:
    """Entries of delivery reports on one link: columns of shape (n,)."""

    seq: Ints
    sent_ns: Ints
    delivered_ns: Ints
    fate: Ints


RowsBySource = dict[tuple[int, str], Rows]


def _by_source(data: RunArrays, receiver: int) -> RowsBySource:
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
    came = np.isin(rows.fate, [data.code(fate) for fate in ArrivalFate])
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
