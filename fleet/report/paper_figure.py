"""One figure of a run, for a notebook or a script."""

from __future__ import annotations

from matplotlib import rc_context
from matplotlib.figure import Figure

from fleet.analysis.recorded_run import RecordedRun
from fleet.errors import ArgumentError
from fleet.report.paper import FIGURES
from fleet.report.paper_style import STYLE
from fleet.report.run_data import run_data_of


def figure_of(run: RecordedRun, kind: str) -> Figure:
    """The figure of this kind; raises ArgumentError if there is none."""
    if kind not in FIGURES:
        raise ArgumentError(f"figure: '{kind}' is none of {', '.join(FIGURES)}")
    with rc_context(STYLE):
        return FIGURES[kind](run_data_of(run))
