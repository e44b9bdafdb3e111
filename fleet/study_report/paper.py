"""Figures of a study for a paper, drawn with Matplotlib: which there are, and how they are written.

Sizes are those of a column or of a page with two columns, so that they go in as they are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from fleet.report.paper_style import STYLE, save_figure
from fleet.study_report.outcomes import outcomes_of
from fleet.study_report.paper_curves import curve_figure, points_figure, separation_survival
from fleet.study_report.paper_maps import map_figure
from fleet.study_report.slices import GridSlice
from fleet.study_report.study_data import StudyData

MOST_SLICES = 12
"""A figure for each combination of levels of factors that are on no axis, up to so many."""

StudyFigures = dict[str, Callable[[], Figure]]
"""What draws each figure, by the name of its file."""

PAPER_STYLE: Any = {
    **STYLE,
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "svg.fonttype": "path",
    "text.parse_math": False,
}


def study_figures(data: StudyData) -> StudyFigures:
    """The figures of a study, none if nothing of it was flown."""
    if not data.flown_cells:
        return {}
    name, found = data.study.name, StudyFigures()
    outcomes = outcomes_of(data)
    if data.factors and not data.grid:
        for outcome in outcomes:
            found[f"{name}_points_{outcome.id}"] = partial(points_figure, data, outcome)
        found[f"{name}_survival"] = partial(separation_survival, data, None)
        return found
    order = _varied_first(data)
    numeric = [n for n in order if data.factors[n].numbers]
    along = (numeric or order)[:1]
    curved = [*along, *[n for n in order if n not in along][:1]]
    for outcome in outcomes if order else []:
        for part in _slices(data, order[:2]):
            found[f"{name}_map_{outcome.id}{_suffix(data, part)}"] = partial(
                map_figure, data, outcome, part
            )
        for part in _slices(data, curved):
            found[f"{name}_curve_{outcome.id}{_suffix(data, part)}"] = partial(
                curve_figure, data, outcome, part
            )
    for part in _slices(data, order[:1]):
        found[f"{name}_survival{_suffix(data, part)}"] = partial(separation_survival, data, part)
    return found


def write_study_figures(figures: StudyFigures, folder: Path, suffix: str, dpi: int) -> None:
    """Draw figures to files of their names, the same each time; raises OSError."""
    with rc_context(PAPER_STYLE):
        for name, draw in figures.items():
            save_figure(draw(), folder / f"{name}.{suffix}", dpi)


def _varied_first(data: StudyData) -> list[int]:
    """Factors by number, those with one level last."""
    return sorted(range(len(data.factors)), key=lambda n: len(data.factors[n].labels) == 1)


def _slices(data: StudyData, axes: Sequence[int]) -> list[GridSlice]:
    """Each combination of levels of the factors that are on no axis."""
    rest = [n for n in range(len(data.factors)) if n not in axes]
    levels = product(*(range(len(data.factors[n].labels)) for n in rest))
    found = [GridSlice(tuple(axes), dict(zip(rest, at, strict=True))) for at in levels]
    return found[:MOST_SLICES]


def _suffix(data: StudyData, part: GridSlice) -> str:
    """Levels of factors that are on no axis, as in `_loss-30`, where they have several."""
    words = [
        f"_{data.factors[n].name}-{_file_words(data.factors[n].labels)[k]}"
        for n, k in part.levels.items()
        if len(data.factors[n].labels) > 1
    ]
    return "".join(words)


def _file_words(labels: Sequence[str]) -> list[str]:
    """Labels as names of files may have them; their numbers, if that makes two of them the same."""
    words = [re.sub("[^A-Za-z0-9.]+", "-", label).strip("-") for label in labels]
    distinct = len(set(words)) == len(words) and all(words)
    return words if distinct else [str(n) for n in range(len(words))]
