"""Latencies counted in bins: a long run has too many to keep, and bins are as many as ever.

A bin is told by its lower edge, in units of 10 us. Up to 0.1 s each unit is a bin, above that they
have four digits: 0.1 ms wide from 0.1 s on, 1 ms from 1 s on.
"""

from __future__ import annotations

from collections import Counter

from fleet.model.units import to_s

LATENCY_BIN_NS = 10_000
FINEST = 10_000
"""Up to so many units a unit is a bin."""


def latency_bin(latency_ns: int) -> int:
    """The bin of a latency."""
    units = latency_ns // LATENCY_BIN_NS
    if -FINEST < units < FINEST:
        return units
    wide: int = 10 ** (len(str(abs(units))) - len(str(FINEST)) + 1)
    return units // wide * wide


def binned_quantiles_s(bins: Counter[int]) -> dict[str, float]:
    """Median, 99th percentile and maximum of latencies counted in bins, to the bin."""
    total, seen = bins.total(), 0
    wanted = {"p50": 0.50 * (total - 1), "p99": 0.99 * (total - 1), "max": total - 1}
    out: dict[str, float] = {}
    for bin_, count in sorted(bins.items()):
        seen += count
        for name, rank in wanted.items():
            if name not in out and round(rank) < seen:
                out[name] = to_s(bin_ * LATENCY_BIN_NS)
    return out
