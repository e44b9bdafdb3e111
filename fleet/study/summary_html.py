"""What a notebook shows of the results of a study."""

from __future__ import annotations

from fleet.html_tables import table_html_of
from fleet.study.results import ResultsFolder
from fleet.study.statistics.estimate import Estimate
from fleet.study.summary import summaries


def summary_html(results: ResultsFolder) -> str:
    """Loss of separation with avoidance and without, and what avoidance leaves of it."""
    factors = [factor.name for factor in results.study.factor]
    heads = [*factors, "runs", "lost, %", "without avoidance, %", "risk ratio"]
    rows = []
    for cell in summaries(results):
        levels = [level.label for level in cell.cell.levels]
        lost = cell.events.get("lost")
        told = ["-"] * 3
        if lost is not None:
            told = [
                _interval(lost.probability, 100.0, 1),
                _interval(lost.without, 100.0, 1),
                _interval(lost.risk_ratio, 1.0, 3),
            ]
        rows.append([*levels, str(cell.runs), *told])
    return table_html_of(heads, rows)


def _interval(found: Estimate, factor: float, digits: int) -> str:
    value, low, high = (f"{factor * x:.{digits}f}" for x in (found.value, found.low, found.high))
    return f"{value} ({low} to {high})"
