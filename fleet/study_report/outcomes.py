"""What a report tells of each cell: probabilities of events and medians, with their intervals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fleet.study.statistics.estimate import LEVEL, Estimate
from fleet.study.statistics.quantiles import quantile_by_order
from fleet.study.summary import SHARES
from fleet.study_report.study_data import ReportedCell, StudyData

MEDIAN = SHARES.index(0.5)
SMALL_PERCENT = 0.095

OfCell = Callable[[ReportedCell], Estimate | None]
"""An estimate of a cell; None where there is none."""


@dataclass(frozen=True)
class ReportedOutcome:
    """An outcome of cells, and what of it comes without avoidance.

    `scale` is by what values are multiplied to be in `unit`. Where `low_is_bad`, as of separation,
    maps are dark where the outcome is low.
    """

    id: str
    title: str
    unit: str
    scale: float
    digits: int
    of: OfCell
    without: OfCell
    low_is_bad: bool = False

    @property
    def label(self) -> str:
        """The title with the unit, as axes have it."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def number(self, value: float, digits: int = 2) -> str:
        """A value in the unit, without it; `digits` are those of small probabilities."""
        shown = value * self.scale
        if math.isinf(shown):
            return "∞" if shown > 0 else "-∞"
        if self.unit == "%":
            return _percent(shown, digits)
        return f"{shown:.{self.digits}f}"

    def value_text(self, estimate: Estimate) -> str:
        """As in `1.5 %`."""
        return f"{self.number(estimate.value)} {self.unit}".rstrip()

    def interval_text(self, estimate: Estimate) -> str:
        """As in `0.9 to 2.4`."""
        digits = 1 if abs(estimate.value * self.scale) >= SMALL_PERCENT else 2
        low, high = (self.number(x, digits) for x in (estimate.low, estimate.high))
        return f"{low} to {high}"

    def text(self, estimate: Estimate | None) -> str:
        """As in `1.5 % (0.9 to 2.4)`; `-` of nothing."""
        if estimate is None or math.isnan(estimate.value):
            return "-"
        return f"{self.value_text(estimate)} ({self.interval_text(estimate)})"


def outcomes_of(data: StudyData) -> list[ReportedOutcome]:
    """The outcomes that are known of some cell of a study."""
    return [outcome for outcome in _ALL if any(map(outcome.of, data.flown_cells))]


def ratio_words(ratio: Estimate | None) -> str:
    """A risk ratio, as in `0.021 (0.010 to 0.044)`; `-` of nothing."""
    if ratio is None or math.isnan(ratio.value):
        return "-"
    value, low, high = (
        "∞" if math.isinf(x) else f"{x:.3f}" for x in (ratio.value, ratio.low, ratio.high)
    )
    return f"{value} ({low} to {high})"


def _percent(value: float, digits: int) -> str:
    """With one digit after the point; below 1 with two in all, far below with so many."""
    if value in {0.0, 100.0}:
        return f"{value:.0f}"
    if value >= 0.95:
        return f"{value:.1f}"
    return f"{value:.2g}" if value >= SMALL_PERCENT else f"{value:.{digits}g}"


def _nothing(_: ReportedCell) -> None:
    return None


def _event(event: str, part: str) -> OfCell:
    def found(cell: ReportedCell) -> Estimate | None:
        summary = cell.summary.events.get(event)
        estimate: Estimate | None = getattr(summary, part) if summary else None
        return estimate

    return found


def _median(column: str) -> OfCell:
    """None where runs have weights."""

    def found(cell: ReportedCell) -> Estimate | None:
        quantiles = cell.summary.quantiles.get(column)
        return quantiles[MEDIAN] if quantiles else None

    return found


def _least_without(cell: ReportedCell) -> Estimate | None:
    values = np.asarray(cell.flown["least_without"], dtype=np.float64)
    values = values[~np.isnan(values)]
    return quantile_by_order(values, 0.5, LEVEL) if len(values) else None


_ALL = (
    ReportedOutcome(
        "lost",
        "P(loss of separation)",
        "%",
        100.0,
        1,
        _event("lost", "probability"),
        _event("lost", "without"),
    ),
    ReportedOutcome(
        "nmac",
        "P(NMAC)",
        "%",
        100.0,
        1,
        _event("nmac", "probability"),
        _event("nmac", "without"),
    ),
    ReportedOutcome(
        "induced",
        "P(lost with avoidance only: induced)",
        "%",
        100.0,
        1,
        _event("lost", "induced"),
        _nothing,
    ),
    ReportedOutcome(
        "unresolved",
        "P(lost with and without: unresolved)",
        "%",
        100.0,
        1,
        _event("lost", "unresolved"),
        _nothing,
    ),
    ReportedOutcome(
        "least_separation",
        "Median least separation / required",
        "",
        1.0,
        3,
        _median("least_separation"),
        _least_without,
        low_is_bad=True,
    ),
    ReportedOutcome(
        "delay", "Median greatest delay", "s", 1.0, 1, _median("delay_max_s"), _nothing
    ),
    ReportedOutcome(
        "path_deviation",
        "Median greatest path deviation",
        "m",
        1.0,
        0,
        _median("path_deviation_max_m"),
        _nothing,
    ),
)
