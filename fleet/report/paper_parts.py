"""Parts of the figures of a run for a paper: panels, pairs in two colours, zones in space."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MaxNLocator

from fleet.analysis.palette import colour_of
from fleet.config.scenario import Zone
from fleet.model.types import Array
from fleet.report.curves import DrawnPair
from fleet.report.paper_style import HALO
from fleet.report.plot import ALERT, LIGHT, RIM, WARN
from fleet.report.resolution import DrawnCandidate
from fleet.report.run_data import RunData

THINNEST = 0.1
"""Least height of a figure from above, of its width (or the other way round)."""

LINE_STYLES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))
"""Tell UAVs of the same colour apart."""


def flying(index: int) -> dict[str, Any]:
    """The look of the line of the UAV in this place of the fleet."""
    colour = colour_of(index)
    dash = LINE_STYLES[index // 7 % len(LINE_STYLES)]
    return {"color": colour, "linestyle": dash, "path_effects": rim(colour)}


def panels(size: tuple[float, float], heights: list[float]) -> tuple[Figure, list[Axes]]:
    """Panels one above the other that share their time axis."""
    figure = Figure(figsize=size, layout="constrained")
    rows = figure.subplots(
        len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    return figure, list(rows[:, 0])


def required(axes: Axes, value: float, words: str) -> None:
    """What is required, as a line, and what is less tinted."""
    axes.axhspan(0.0, value, color=WARN, alpha=0.55, lw=0, zorder=0)
    axes.axhline(value, color=ALERT, linestyle=(0, (5, 3)), linewidth=1.2, zorder=2)
    axes.annotate(
        words,
        (0.01, value),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3),
        textcoords="offset points",
        color=ALERT,
        fontsize=8,
        path_effects=HALO,
    )


def braided(axes: Axes, pair: DrawnPair, values: Array) -> None:
    """A line in the colours of both UAVs."""
    one, two = colour_of(pair.a.index), colour_of(pair.b.index)
    axes.plot(pair.times_s, values, color=one, lw=1.8, path_effects=rim(one), zorder=3)
    axes.plot(pair.times_s, values, color=two, lw=1.8, linestyle=(0, (4, 4)), zorder=3)


def rim(colour: str) -> list[Any]:
    """A dark rim under colours that are too light for paper."""
    return [Stroke(linewidth=2.8, foreground=RIM), Normal()] if colour in LIGHT else []


def draw_candidate(axes: Any, candidate: DrawnCandidate, colour: str) -> None:
    """One candidate in space: bold if it was chosen, reddish if it is not safe."""
    path, logged = candidate.ned_m, candidate.logged
    look: dict[str, Any] = {"color": "#7d8b99", "lw": 0.8, "zorder": 2}
    if logged.chosen:
        look = {"color": colour, "lw": 3.2, "zorder": 5}
    elif not logged.safe:
        look["color"] = "#d98a9b"
    axes.plot(path[:, 1], path[:, 0], -path[:, 2], **look)


def ground_m(run_data: RunData, shown: int) -> float:
    """A little below the lowest altitude that is drawn."""
    low = min(float(np.nanmin(-f.ned_m[:shown, 2])) for f in run_data.flights)
    zones = [run_data.scenario.zone_of(f.id) for f in run_data.flights]
    return low - 2.0 * max(zone.half_height_m for zone in zones)


def draw_zone(axes: Any, zone: Zone, ned: Array, colour: str) -> None:
    """A protected zone as a translucent cylinder."""
    if not np.isfinite(ned[0]):
        return
    angle = np.linspace(0.0, math.tau, 25)
    east = ned[1] + zone.radius_m * np.cos(angle)
    north = ned[0] + zone.radius_m * np.sin(angle)
    up = -ned[2] + np.array([[-zone.half_height_m], [zone.half_height_m]])
    axes.plot_surface(
        np.vstack([east, east]),
        np.vstack([north, north]),
        np.broadcast_to(up, (2, len(angle))),
        color=colour,
        alpha=0.35,
        linewidth=0,
        shade=False,
        zorder=3,
    )
    for height in up[:, 0]:
        axes.plot(east, north, height, color=colour, lw=0.8, zorder=3)


def broad(axes: Any) -> None:
    """Widen the axes of a figure from above in which all fly along one line."""
    spans = [(axes.set_xlim, axes.get_xlim()), (axes.set_ylim, axes.get_ylim())]
    least = THINNEST * max(high - low for _, (low, high) in spans)
    for widen, (low, high) in spans:
        if high - low < least:
            widen(0.5 * (low + high - least), 0.5 * (low + high + least))


def space(axes: Any) -> None:
    """Axes of a figure in space; a metre is as long to the east as to the north."""
    east, north = axes.get_xlim(), axes.get_ylim()
    half = max(east[1] - east[0], north[1] - north[0]) / 2.0
    axes.set_xlim(sum(east) / 2.0 - half, sum(east) / 2.0 + half)
    axes.set_ylim(sum(north) / 2.0 - half, sum(north) / 2.0 + half)
    axes.set_xlabel("East (m)", labelpad=6)
    axes.set_ylabel("North (m)", labelpad=6)
    axes.set_zlabel("Altitude (m)", labelpad=4)
    axes.view_init(elev=26, azim=-122)
    axes.set_box_aspect((1.25, 1.25, 0.7), zoom=0.92)
    axes.tick_params(labelsize=8, pad=1)
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.set_pane_color((0.98, 0.985, 0.99, 1.0))
        pane.set_major_locator(MaxNLocator(6))
