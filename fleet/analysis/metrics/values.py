"""What several rows of metrics are made of: volumes, times in them, and spreads of numbers."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fleet.analysis.metrics.definition import described, metric_row
from fleet.model.conflict.risk import Required

FOOT_M = 0.3048

ZONE = "zone"
"""The volume that separation is about: both protected zones of a pair together."""

BY_VOLUME = "by volume"
"""Heading of what has a column or a line for each volume, with the names of these."""


@metric_row
class Volume:
    """A cylinder round one UAV that others must stay out of: its radius and half its height."""

    name: str = described("-", "its name", source="-")
    horizontal_m: float = described(
        "m",
        "horizontal distance below which a pair may be inside",
        symbol="H",
        source="default NMAC: 152.4 m = 500 ft (RTCA DO-365)",
    )
    vertical_m: float = described(
        "m",
        "vertical distance below which it then is",
        symbol="V",
        source="default NMAC: 30.48 m = 100 ft (RTCA DO-365)",
    )


NMAC = Volume("nmac", 500.0 * FOOT_M, 100.0 * FOOT_M)
"""Near mid-air collision: nearer than 500 ft horizontally and than 100 ft vertically at once."""


def zone_volume(required: Required) -> Volume:
    """The volume `zone`, of what a pair requires."""
    return Volume(ZONE, required.horizontal_m, required.vertical_m)


@metric_row
class Spread:
    """How a number is distributed: quantiles are values that occur (the nearest rank)."""

    count: int = described("1", "number of values", default=0, symbol="n", source="-")
    mean: float | None = described("as named", "their mean", default=None, source="-")
    p50: float | None = described(
        "as named",
        "median: the value of rank round(0.50 (n - 1)) from 0, in rising order",
        default=None,
        source="nearest rank",
    )
    p95: float | None = described(
        "as named",
        "the same with 0.95",
        default=None,
        source="nearest rank",
    )
    p99: float | None = described(
        "as named",
        "the same with 0.99",
        default=None,
        source="nearest rank",
    )
    max: float | None = described(
        "as named",
        "the greatest; blank for an expected one",
        default=None,
        source="-",
    )

    @classmethod
    def of(cls, values: Iterable[float]) -> Spread:
        """The spread of these values; blank for none."""
        ordered = np.sort(np.fromiter(values, dtype=np.float64))
        if not len(ordered):
            return cls()
        last = len(ordered) - 1
        p50, p95, p99 = (float(ordered[round(q * last)]) for q in (0.50, 0.95, 0.99))
        return cls(len(ordered), float(ordered.mean()), p50, p95, p99, float(ordered[-1]))


@metric_row
class Incursion:
    """One time for which a pair was inside a volume."""

    start_s: float = described("s", "when s(t) < 1 begins (or the record does)", symbol="t_in")
    end_s: float = described("s", "when it ends (or the record does)", symbol="t_out")
    severity: float = described(
        "1",
        "1 - min of s(t) meanwhile: 0 at the edge, 1 where both are at one point. The same as "
        "the maximum over t of min(1 - h/H, 1 - v/V), the lesser of both intrusions",
        symbol="S",
        source="ours, in the manner of the intrusion severity of airspace studies "
        "(Sunil et al. 2015)",
    )


@metric_row
class Incursions:
    """How often, how long and how far a pair was inside a volume."""

    volume: str = described("-", "name of the volume", source="-")
    count: int = described("1", "number of times for which the pair was inside", symbol="n")
    duration_s: float = described("s", "sum of t_out - t_in over them")
    severity: float = described("1", "the greatest of theirs; 0 for none", symbol="S")
    first_s: float | None = described("s", "begin of the first", symbol="t_L")
    events: tuple[Incursion, ...] = described("-", "each: [Incursion](#incursion)", source="-")
