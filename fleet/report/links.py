"""What became of messages on their way: shares delivered, latencies, and each message by itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.latency_bins import binned_quantiles_s
from fleet.analysis.tally import RunTally
from fleet.model.types import Array
from fleet.model.words import ArrivalFate
from fleet.protocol.classes import DELIVERY_ORDER
from fleet.report.run_data import LinkMessages, RunData

DRAWN = DELIVERY_ORDER[::-1]
"""Classes in the order in which they are let into the message diagram."""


@dataclass(frozen=True)
class ClassRow:
    """One class of messages: how many were sent (times receivers), came, and were kept away."""

    kind: str
    messages: int
    sent: int
    came: int
    dropped: Mapping[str, int]
    latency_s: Mapping[str, float]

    @property
    def known(self) -> int:
        """Those whose fate is known: they came, or were kept away."""
        return self.came + sum(self.dropped.values())


def class_rows(tally: RunTally) -> list[ClassRow]:
    """One row for each class that was sent."""
    out = []
    for kind in (k for k in DRAWN if tally.sent[k]):
        fates = Counter({fate: n for (k, fate), n in tally.fates.items() if k == kind})
        came = sum(fates.pop(fate, 0) for fate in ArrivalFate)
        latency = binned_quantiles_s(tally.latencies[kind])
        row = ClassRow(kind, tally.transmitted[kind], tally.sent[kind], came, dict(fates), latency)
        out.append(row)
    return out


def delivered(link_messages: LinkMessages) -> NDArray[np.bool_]:
    """Which messages came."""
    return np.isfinite(link_messages.delivered_s)


def share_by_link(run_data: RunData) -> tuple[Array, NDArray[np.int64]]:
    """Share delivered and number of messages from each process (row) to each (column), in order.

    NaN where nothing was sent.
    """
    link_messages, numbers = run_data.link_messages, np.array(run_data.processes, dtype=np.int64)
    count = len(numbers)
    place = np.searchsorted(numbers, link_messages.src) * count + np.searchsorted(
        numbers, link_messages.dst
    )
    total = np.bincount(place, minlength=count**2)
    came = np.bincount(place, weights=delivered(link_messages), minlength=count**2)
    share = np.where(total > 0, came / np.maximum(total, 1), np.nan)
    return share.reshape(count, count), total.reshape(count, count).astype(np.int64)


def share_over_time(run_data: RunData, bin_s: float) -> tuple[Array, dict[str, Array]]:
    """Middles of bins of the time of sending, and for each class the share that came of each."""
    link_messages = run_data.link_messages
    edges = np.arange(0.0, run_data.end_s + bin_s, bin_s)
    out = {}
    for number, kind in sorted(
        enumerate(link_messages.kind_names), key=lambda k: DRAWN.index(k[1])
    ):
        mine = link_messages.kinds == number
        total = np.histogram(link_messages.sent_s[mine], edges)[0]
        came = np.histogram(link_messages.sent_s[mine & delivered(link_messages)], edges)[0]
        out[kind] = np.where(total > 0, came / np.maximum(total, 1), np.nan)
    return edges[:-1] + bin_s / 2.0, out


def latencies(run_data: RunData) -> dict[str, tuple[Array, Array]]:
    """For each class the latencies that occurred, in s, and the share that came within each."""
    out = {}
    bins = run_data.tally.latencies
    for kind in (k for k in DRAWN if bins.get(k)):
        ordered = sorted(bins[kind].items())
        values = np.array([value for value, _ in ordered], dtype=np.float64) * 1e-5
        share = np.cumsum([n for _, n in ordered]) / bins[kind].total()
        out[kind] = (values, share)
    return out


def message_columns(run_data: RunData, most: int) -> tuple[dict[str, Any], list[str]]:
    """The messages of the diagram as columns in order of sending, and the classes left out.

    Rare classes come first, and a class is left out as a whole if it would be too many. `src` and
    `dst` are places among the processes; a message that was lost has no `got_s` (NaN).
    """
    link_messages = run_data.link_messages
    wanted, left_out, room = np.zeros(len(link_messages), dtype=np.bool_), list[str](), most
    for kind in (k for k in DRAWN if k in link_messages.kind_names):
        mine = link_messages.kinds == link_messages.kind_names.index(kind)
        if (count := int(mine.sum())) <= room:
            wanted |= mine
            room -= count
        else:
            left_out.append(kind)
    picked = np.flatnonzero(wanted)
    picked = picked[np.argsort(link_messages.sent_s[picked], kind="stable")]
    numbers = np.array(run_data.processes, dtype=np.int64)
    columns = {
        "src": np.searchsorted(numbers, link_messages.src[picked]),
        "dst": np.searchsorted(numbers, link_messages.dst[picked]),
        "kind": link_messages.kinds[picked],
        "fate": link_messages.fates[picked],
        "sent_s": link_messages.sent_s[picked],
        "got_s": link_messages.delivered_s[picked],
    }
    return columns, left_out
