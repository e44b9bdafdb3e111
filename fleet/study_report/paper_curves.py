"""Curves, survival curves and points of a study for a paper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fleet.model.types import Array
from fleet.report.plot import ALERT, GREY
from fleet.study.statistics.estimate import Estimate
from fleet.study_report.chart_data import same_text
from fleet.study_report.colours import LINE_COLOURS
from fleet.study_report.outcomes import OfCell, ReportedOutcome
from fleet.study_report.paper_labels import (
    COLUMN_IN,
    LINE_IN,
    PAGE_IN,
    fitted,
    in_lines,
    line_count,
)
from fleet.study_report.separation_curves import SeparationCurve, separation_curves
from fleet.study_report.slices import GridSlice
from fleet.study_report.study_data import ReportedCell, ReportedFactor, StudyData

HEIGHT_IN = 2.5
WRAP = 26
"""Letters in a line of a label beside an axis."""
LONG_NAME, LEGEND_LETTERS, LEGEND_ROW_IN = 20, 46, 0.15
LEVEL_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (5, 2, 1, 2)), (0, (8, 3)))
MARKERS = "osD^vp*"
DOTTED = (0, (1, 1.5))


def curve_figure(data: StudyData, outcome: ReportedOutcome, part: GridSlice) -> Figure:
    """An outcome against a factor, a line for each level of another, with and without avoidance."""
    along = data.factors[part.axes[0]]
    width, labels = (COLUMN_IN, list[str]()) if along.numbers else fitted(along.labels)
    height = HEIGHT_IN + LINE_IN * (line_count(labels) - 1)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot()
    named = data.factors[part.axes[1]] if len(part.axes) > 1 else None
    same = same_text(outcome, [outcome.without(cell) for cell in data.cells])
    count = len(named.labels) if named else 1
    for k in range(count):
        cells = [part.cell(data, *((n, k) if named else (n,))) for n in range(len(along.labels))]
        shift = 0.0 if along.numbers else (k - (count - 1) / 2) * min(0.16, 0.6 / count)
        x, found = _points(along, cells, outcome.of)
        label = f"{named.name} {named.labels[k]}" if named else "with avoidance"
        _with(axes, x + shift, found, outcome, _Look(k, label, along.numbers is not None))
        if k == 0 or not same:
            x, found = _points(along, cells, outcome.without)
            y = outcome.scale * np.array([e.value for e in found])
            colour = GREY if same else line_colour(k)
            style: dict[str, Any] = {"color": colour, "lw": 1.0, "ms": 4, "marker": "x", "mew": 0.9}
            axes.plot(x if same else x + shift, y, ls=DOTTED if along.numbers else "none", **style)
    if any(outcome.without(cell) for cell in data.cells):
        _name_without(axes)
    if along.numbers is None:
        axes.set_xticks(range(len(labels)), labels)
        axes.set_xlim(-0.5, len(labels) - 0.5)
    if outcome.unit == "%":
        axes.set_ylim(bottom=0.0)
    axes.set_xlabel(along.title)
    axes.set_ylabel(fill(outcome.label, WRAP))
    axes.set_title(part.words(data))
    _legend(figure, axes)
    return figure


def separation_survival(data: StudyData, part: GridSlice | None) -> Figure:
    """The share of runs that keep at least so much separation, a line for each level."""
    curves = separation_curves(data)
    figure = Figure(figsize=(COLUMN_IN, HEIGHT_IN), layout="constrained")
    axes = figure.add_subplot()
    for k, (cell, label) in enumerate(_listed(data, part, curves.chosen)):
        number = cell.cell.number
        if number not in curves.by_cell:
            continue
        found, colour = curves.by_cell[number], line_colour(k)
        band: dict[str, Any] = {"step": "pre", "color": colour, "alpha": 0.14, "lw": 0}
        axes.fill_between(found.at, 100 * found.low, 100 * found.high, **band)
        _steps(axes, found, label, color=colour, lw=1.3, ls=_dash(k))
        if not curves.same_without:
            _steps(axes, curves.without[number], None, color=colour, lw=1.0, ls=DOTTED)
    if curves.same_without:
        (without,) = curves.without.values()
        _steps(axes, without, None, color=GREY, lw=1.1, ls=DOTTED)
    _name_without(axes)
    axes.axvline(1.0, color=ALERT, lw=1.1, ls=(0, (5, 3)), zorder=3)
    axes.set_xlim(0.0, curves.end)
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel("Least separation of a run / required")
    axes.set_ylabel("Runs that keep it (%)")
    axes.set_title(part.words(data) if part else "")
    _legend(figure, axes)
    return figure


def points_figure(data: StudyData, outcome: ReportedOutcome) -> Figure:
    """An outcome of cells that were drawn, against each factor."""
    count = len(data.factors)
    across = min(count, 3)
    down = math.ceil(count / across)
    width = COLUMN_IN if count == 1 else PAGE_IN
    figure = Figure(figsize=(width, 2.2 * down + 0.2), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False, sharey=True)
    known = [(cell, e) for cell in data.flown_cells if (e := outcome.of(cell)) is not None]
    y = np.array([e.value for _, e in known]) * outcome.scale
    reach = _reach([e for _, e in known], outcome)
    for n, axes in enumerate(panels.flat):
        if n >= count:
            axes.set_visible(False)
            continue
        x = [cell.cell.levels[n].number or 0.0 for cell, _ in known]
        look = {"elinewidth": 0.5, "ms": 2.6, "ecolor": "#a9c6dc", "color": LINE_COLOURS[0]}
        axes.errorbar(x, y, yerr=reach, fmt="o", **look)
        axes.set_xlabel(data.factors[n].title)
        if n % across == 0:
            axes.set_ylabel(fill(outcome.label, WRAP))
    return figure


def line_colour(place: int) -> str:
    """The colour of the line of a level, as on the page."""
    return LINE_COLOURS[place % len(LINE_COLOURS)]


def _dash(place: int) -> Any:
    return LEVEL_DASHES[place // len(LINE_COLOURS) % len(LEVEL_DASHES)]


def _listed(
    data: StudyData, part: GridSlice | None, chosen: tuple[int, ...]
) -> list[tuple[ReportedCell, str]]:
    """Cells of a figure, and how their lines are named."""
    if part is None or chosen:
        return [(data.cells[n], f"cell {data.cells[n].name}") for n in chosen]
    if not part.axes:
        return [(part.cell(data), "with avoidance")]
    factor = data.factors[part.axes[0]]
    return [(part.cell(data, n), f"{factor.name} {label}") for n, label in enumerate(factor.labels)]


def _points(
    along: ReportedFactor, cells: list[ReportedCell], of: OfCell
) -> tuple[Array, list[Estimate]]:
    """Places along a factor, rising, and estimates there."""
    places = along.numbers or tuple(float(n) for n in range(len(cells)))
    known = [(x, e) for x, cell in zip(places, cells, strict=True) if (e := of(cell)) is not None]
    known.sort(key=lambda point: point[0])
    return np.array([x for x, _ in known]), [e for _, e in known]


@dataclass(frozen=True)
class _Look:
    """Of a line: its place among the lines, its name, whether it is one, or single points."""

    place: int
    label: str
    joined: bool


def _with(
    axes: Axes, x: Array, found: list[Estimate], outcome: ReportedOutcome, look: _Look
) -> None:
    """A line with its band, or points with their intervals."""
    y, reach = outcome.scale * np.array([e.value for e in found]), _reach(found, outcome)
    colour, marker = line_colour(look.place), MARKERS[look.place % len(MARKERS)]
    style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 3.6, "label": look.label}
    if not look.joined:
        axes.errorbar(x, y, yerr=reach, fmt=" ", elinewidth=1.0, capsize=2, **style)
        return
    axes.fill_between(x, y - reach[0], y + reach[1], color=colour, alpha=0.16, lw=0)
    axes.plot(x, y, lw=1.3, ls=_dash(look.place), **style)


def _steps(axes: Axes, curve: SeparationCurve, label: str | None, **look: Any) -> None:
    axes.step(curve.at, 100 * curve.share, where="pre", label=label, **look)


def _name_without(axes: Axes) -> None:
    """What dotted lines are, for the legend."""
    axes.plot([], [], color=GREY, lw=1.0, ls=DOTTED, label="without avoidance")


def _reach(found: list[Estimate], outcome: ReportedOutcome) -> Array:
    """How far intervals reach below and above their values; nothing where there is no bound."""
    below = [e.value - e.low if math.isfinite(e.low) else 0.0 for e in found]
    above = [e.high - e.value if math.isfinite(e.high) else 0.0 for e in found]
    return outcome.scale * np.array([below, above])


def _legend(figure: Figure, axes: Axes) -> None:
    """A legend above the axes, for which the figure grows; long names stand one below another."""
    handles, labels = axes.get_legend_handles_labels()
    columns = 1 if max(map(len, labels), default=0) > LONG_NAME else 2
    labels = [in_lines(label, LEGEND_LETTERS) for label in labels]
    rows = math.ceil(len(handles) / columns) + sum(label.count("\n") for label in labels)
    if rows:
        figure.set_figheight(figure.get_figheight() + LEGEND_ROW_IN * max(0, rows - 2))
        figure.legend(handles, labels, loc="outside upper left", ncols=columns, handlelength=2.2)
