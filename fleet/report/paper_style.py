"""How figures for a paper look, and how they are written: the same each time, fonts in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from fleet.report.plot import GREY, INK

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e8ebef",
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "svg.fonttype": "none",
    "svg.hashsalt": "fleet",
    "pdf.fonttype": 42,
}
"""What Matplotlib is told (`rc_context`)."""
HALO = [Stroke(linewidth=2.5, foreground="white"), Normal()]


def save_figure(figure: Figure, file: Path, dpi: int, **how: Any) -> None:
    """Write a figure as what its suffix says, without a date; raises OSError.

    `how` is for `Figure.savefig`.
    """
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(file.suffix, {})
    figure.savefig(file, dpi=dpi, metadata=undated, **how)
