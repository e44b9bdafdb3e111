"""What a study says, as tables for people."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from rich import box
from rich.console import JustifyMethod
from rich.table import Table

from fleet.analysis.words import counted
from fleet.study.statistics.estimate import Estimate
from fleet.study.study_file import Study
from fleet.study.summary import CellSummary

SHOWN_CELLS = 60


CellColumn = tuple[str, Callable[[CellSummary], str]]
"""A heading, and what a cell has below it."""


def study_tables(study: Study, found: Sequence[CellSummary], width: int) -> Iterator[Table]:
    """Loss of separation, NMAC and what avoidance costs, a row each cell.

    What is wider than `width` goes on in a further table, which begins with the cell again.
    """
    for title, columns in (
        ("loss of separation, % of runs", _event_columns("lost")),
        ("NMAC, % of runs", _event_columns("nmac")),
        ("what it costs: 5 %, median, 95 %", COSTS),
    ):
        texts = _texts(found[:SHOWN_CELLS], (_head(study), *columns))
        for chosen in _fitting(texts, width):
            table = Table(title=f"{study.name}: {title}", title_justify="left", box=box.SIMPLE_HEAD)
            for place in chosen:
                justify: JustifyMethod = "right" if place else "left"
                table.add_column(texts[place][0], justify=justify, no_wrap=True)
            for row in zip(*(texts[place][1:] for place in chosen), strict=True):
                table.add_row(*row)
            if len(found) > SHOWN_CELLS:
                table.caption = f"and {len(found) - SHOWN_CELLS} cells more: see runs.parquet"
            yield table


def _texts(rows: Sequence[CellSummary], columns: Sequence[CellColumn]) -> list[list[str]]:
    """Each column, with its heading."""
    return [[heading, *(text(cell) for cell in rows)] for heading, text in columns]


def _fitting(texts: Sequence[Sequence[str]], width: int) -> Iterator[list[int]]:
    """Columns that go beside each other in a width, the first in each; no cell is broken."""
    widths = [
        3 + max(len(line) for text in column for line in text.split("\n")) for column in texts
    ]
    chosen, left = [0], width - widths[0] - 1
    for place in range(1, len(texts)):
        if len(chosen) > 1 and widths[place] > left:
            yield chosen
            chosen, left = [0], width - widths[0] - 1
        chosen.append(place)
        left -= widths[place]
    yield chosen


def _head(study: Study) -> CellColumn:
    names = ", ".join(factor.name for factor in study.factor)

    def text(cell: CellSummary) -> str:
        labels = ", ".join(level.label for level in cell.cell.levels) or "all"
        return f"{cell.cell.number}: {labels} ({counted(cell.runs, 'run')}{_worth(cell)})"

    return (f"cell: {names}".removesuffix(": "), text)


def _worth(cell: CellSummary) -> str:
    return f", worth {cell.worth:.0f}" if round(cell.worth) < cell.runs else ""


def _event_columns(event: str) -> tuple[CellColumn, ...]:
    def shown(name: str, text: Callable[[Estimate], str]) -> Callable[[CellSummary], str]:
        def in_cell(cell: CellSummary) -> str:
            return text(getattr(cell.events[event], name)) if cell.runs else "-"

        return in_cell

    return (
        ("with\navoidance", shown("probability", percent_text)),
        ("without", shown("without", percent_text)),
        ("risk ratio", shown("risk_ratio", ratio_text)),
        ("induced", shown("induced", percent_text)),
        ("unresolved", shown("unresolved", percent_text)),
    )


def _quantile(name: str, digits: int) -> Callable[[CellSummary], str]:
    def in_cell(cell: CellSummary) -> str:
        found = cell.quantiles.get(name, ())
        return " ".join(f"{estimate.value:.{digits}f}" for estimate in found) or "-"

    return in_cell


COSTS: tuple[CellColumn, ...] = (
    ("least\nseparation", _quantile("least_separation", 3)),
    ("greatest\ndelay, s", _quantile("delay_max_s", 1)),
    ("off plan, m", _quantile("path_deviation_max_m", 0)),
    ("commands", _quantile("commands", 0)),
    ("command\nlatency, s", _quantile("command_latency_s", 2)),
    ("not arrived", lambda cell: f"{cell.not_arrived} of {cell.due}"),
)
"""Quantiles of a run are told as those of 5, 50 and 95 percent."""


def percent_text(estimate: Estimate) -> str:
    """A probability in percent with its interval, as in `1.5 (0.9 to 2.4)`."""
    value, low, high = (100.0 * x for x in (estimate.value, estimate.low, estimate.high))
    return f"{value:.1f} ({low:.1f} to {high:.1f})"


def ratio_text(estimate: Estimate) -> str:
    """A ratio with its interval, as in `0.021 (0.010 to 0.044)`; `-` if it is not known."""
    if math.isnan(estimate.value):
        return "-"
    return f"{estimate.value:.3f} ({estimate.low:.3f} to {estimate.high:.3f})"
