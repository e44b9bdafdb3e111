"""Heat maps of a study for a paper."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from fleet.report.plot import GREY, INK
from fleet.study_report.chart_data import colour_bounds, same_text
from fleet.study_report.colours import RAMP
from fleet.study_report.outcomes import ReportedOutcome
from fleet.study_report.paper_labels import LINE_IN, PAGE_IN, fitted, in_lines, line_count
from fleet.study_report.slices import GridSlice
from fleet.study_report.study_data import ReportedCell, StudyData

ROW_IN, AROUND_IN = 0.5, 0.95
MOST_COLUMNS = 4
"""More columns than these take the width of a page."""
ROW_LETTERS, ROW_LINES = 16, 3
"""Letters in a line of the label of a row, and lines."""
DARK = 0.45
"""From here on the ramp is dark enough for white text."""


def map_figure(data: StudyData, outcome: ReportedOutcome, part: GridSlice) -> Figure:
    """An outcome over one or two factors: a field a cell, with value and interval."""
    counts = part.counts(data)
    columns, rows = counts[0], counts[1] if len(counts) > 1 else 1
    width, labels = fitted(data.factors[part.axes[0]].labels)
    width = width if columns <= MOST_COLUMNS else PAGE_IN
    height = AROUND_IN + ROW_IN * max(rows, 2) + LINE_IN * (line_count(labels) - 1)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot()
    cells = [
        [part.cell(data, *((c, r) if len(counts) > 1 else (c,))) for c in range(columns)]
        for r in range(rows)
    ]
    values = np.array([[_value(outcome, cell) for cell in row] for row in cells])
    known = [e for e in map(outcome.of, data.cells) if e is not None]
    ramp = LinearSegmentedColormap.from_list("ramp", RAMP[::-1] if outcome.low_is_bad else RAMP)
    low, high = colour_bounds(outcome, known)
    image = axes.pcolormesh(values, cmap=ramp, vmin=low, vmax=high, edgecolors="white", linewidth=1)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=18)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=6.5, length=2)
    if outcome.unit:
        bar.set_label(outcome.unit, fontsize=7)
    without = same_text(outcome, [outcome.without(cell) for cell in data.cells])
    for r, row in enumerate(cells):
        for c, cell in enumerate(row):
            _field(axes, (c + 0.5, r + 0.5), outcome, cell, Normalize(low, high))
    _axes(axes, data, part, labels)
    words = [outcome.title, part.words(data), f"without avoidance {without}" if without else ""]
    axes.set_title("\n".join(w for w in words if w), fontsize=7.5)
    return figure


def _value(outcome: ReportedOutcome, cell: ReportedCell) -> float:
    found = outcome.of(cell)
    return float("nan") if found is None else found.value * outcome.scale


def _field(
    axes: Axes,
    at: tuple[float, float],
    outcome: ReportedOutcome,
    cell: ReportedCell,
    norm: Normalize,
) -> None:
    found = outcome.of(cell)
    if found is None:
        axes.text(*at, "no run", ha="center", va="center", fontsize=6.5, color=GREY)
        return
    share = float(norm(found.value * outcome.scale))
    dark = (1.0 - share if outcome.low_is_bad else share) > DARK
    look: dict[str, Any] = {"ha": "center", "color": "white" if dark else INK}
    axes.text(*at, outcome.value_text(found), va="bottom", fontsize=7.5, weight="bold", **look)
    axes.text(at[0], at[1] - 0.06, outcome.interval_text(found), va="top", fontsize=6, **look)


def _axes(axes: Axes, data: StudyData, part: GridSlice, labels: list[str]) -> None:
    axes.grid(visible=False)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    across = data.factors[part.axes[0]]
    axes.set_xticks(np.arange(len(labels)) + 0.5, labels)
    axes.set_xlabel(across.name)
    axes.set_yticks([])
    if len(part.axes) > 1:
        up = data.factors[part.axes[1]]
        rows = [in_lines(label, ROW_LETTERS, ROW_LINES) for label in up.labels]
        axes.set_yticks(np.arange(len(rows)) + 0.5, rows)
        axes.set_ylabel(up.name)
