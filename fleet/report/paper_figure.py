"""One figure of a run, for a notebook or a script."""

from __future__ import annotations

import io

from matplotlib import rc_context
from matplotlib.figure import Figure

from fleet.analysis.recorded_run import RecordedRun
from fleet.errors import ArgumentError
from fleet.report.paper import FIGURES
from fleet.report.paper_style import STYLE
from fleet.report.run_data import run_data_of


class NotebookFigure(Figure):
    """A figure that a notebook shows, also where pyplot has not been imported before."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png", dpi=110, bbox_inches="tight")
        return picture.getvalue()


def figure_of(run: RecordedRun, kind: str) -> Figure:
    """The figure of this kind; raises ArgumentError if there is none."""
    if kind not in FIGURES:
        raise ArgumentError(f"figure: '{kind}' is none of {', '.join(FIGURES)}")
    with rc_context(STYLE):
        figure = FIGURES[kind](run_data_of(run))
    figure.__class__ = NotebookFigure
    return figure
