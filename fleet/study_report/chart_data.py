"""What the script of a study's page draws its charts from: factors, cells and their estimates."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fleet.report.plot import Json
from fleet.study.statistics.estimate import Estimate
from fleet.study_report.colours import LINE_COLOURS, RAMP
from fleet.study_report.outcomes import ReportedOutcome, outcomes_of
from fleet.study_report.separation_curves import SeparationCurves, separation_curves
from fleet.study_report.study_data import ReportedCell, StudyData

MOST_BARS = 300
"""So many points that were drawn have bars for their intervals."""


def chart_data_of(data: StudyData) -> Json:
    """All numbers of the charts, and the texts of their values, in the order of the cells."""
    return {
        "grid": data.grid,
        "factors": [
            {"name": f.name, "title": f.title, "labels": f.labels, "numbers": f.numbers}
            for f in data.factors
        ],
        "cells": [_cell(cell) for cell in data.cells],
        "outcomes": [outcome_data(outcome, data.cells) for outcome in outcomes_of(data)],
        "survival": _survival(separation_curves(data)),
        "ramp": RAMP,
        "colours": LINE_COLOURS,
        "most_bars": MOST_BARS,
    }


def outcome_data(outcome: ReportedOutcome, cells: Sequence[ReportedCell]) -> Json:
    """An outcome in each cell, with and without avoidance."""
    found = [outcome.of(cell) for cell in cells]
    without = [outcome.without(cell) for cell in cells]
    return {
        "id": outcome.id,
        "title": outcome.title,
        "label": outcome.label,
        "unit": outcome.unit,
        "low_is_bad": outcome.low_is_bad,
        "bounds": colour_bounds(outcome, [e for e in found if e is not None]),
        **_columns(outcome, found),
        "without": _columns(outcome, without) if any(without) else None,
        "same_without": same_text(outcome, without),
    }


def colour_bounds(outcome: ReportedOutcome, found: Sequence[Estimate]) -> tuple[float, float]:
    """From where to where the colours of a map go, in the unit: probabilities from 0."""
    values = [e.value * outcome.scale for e in found if math.isfinite(e.value)]
    low = 0.0 if outcome.unit == "%" or not values else min(values)
    high = max(values, default=0.0)
    return (low, high) if high > low else (low, low + 1.0)


def same_text(outcome: ReportedOutcome, without: Sequence[Estimate | None]) -> str:
    """What comes without avoidance, if that is the same in all cells; empty if it is not."""
    texts = {outcome.text(estimate) for estimate in without if estimate is not None}
    return texts.pop() if len(texts) == 1 else ""


def _cell(cell: ReportedCell) -> Json:
    return {
        "at": cell.at,
        "numbers": [level.number for level in cell.cell.levels],
        "name": cell.name,
        "runs": cell.summary.runs,
    }


def _columns(outcome: ReportedOutcome, found: Sequence[Estimate | None]) -> Json:
    scaled = [[_finite(x * outcome.scale) for x in _three(e)] for e in found]
    value, low, high = (list(column) for column in zip(*scaled, strict=True))
    return {
        "value": value,
        "low": low,
        "high": high,
        "text": ["" if e is None else outcome.value_text(e) for e in found],
        "interval": ["" if e is None else outcome.interval_text(e) for e in found],
    }


def _three(estimate: Estimate | None) -> tuple[float, float, float]:
    if estimate is None:
        return math.nan, math.nan, math.nan
    return estimate.value, estimate.low, estimate.high


def _finite(value: float) -> float | None:
    """JSON has neither nan nor infinity."""
    return float(f"{value:.8g}") if math.isfinite(value) else None


def _survival(curves: SeparationCurves) -> Json:
    return {
        "end": curves.end,
        "chosen": curves.chosen,
        "curves": {str(number): curve.packed() for number, curve in curves.by_cell.items()},
        "without": {str(number): curve.packed() for number, curve in curves.without.items()},
        "same_without": curves.same_without,
    }
