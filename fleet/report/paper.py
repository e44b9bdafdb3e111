"""Figures for a paper, drawn with Matplotlib: each is a function of a run.

Those of the paper's own encounters have the paper's numbers (`figure_03` to `figure_10`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fleet.analysis.palette import colour_of
from fleet.model.words import AVOIDING, CLIMBING, TURNING, Manoeuvre, Mode
from fleet.report.curves import (
    DrawnPair,
    FlownCommand,
    flown_commands,
    pair_curves,
    steps,
    true_spans,
)
from fleet.report.draw_time import boolean
from fleet.report.paper_parts import (
    braided,
    broad,
    draw_candidate,
    draw_zone,
    flying,
    ground_m,
    panels,
    required,
    rim,
    space,
)
from fleet.report.paper_style import HALO, STYLE, save_figure
from fleet.report.plot import GREY, INK, PALE
from fleet.report.resolution import resolutions
from fleet.report.risk import risks
from fleet.report.run_data import RunData

NUMBERS = {
    "head_on": {"separation": 3, "commands": 4, "trajectories": 5},
    "side": {"separation": 6, "commands": 7, "trajectories": 8},
    "four_way": {"trajectories": 9, "pairs": 10},
}
"""The paper's figures by scenario; all others are named by scenario and kind."""
AFTER_S = 45.0
"""Figures go on for so long after the last command and the nearest moment."""
PAIRS_IN_COLOUR, PAIRS_AT_ALL = 12, 100
TICK_S = 20.0
MOST_NAMED = 8
"""Larger fleets have no legend."""


def names_of(run_data: RunData) -> dict[str, str]:
    """The name of each figure that this run has, without its suffix, by kind."""
    kinds = ["trajectories", "plan"]
    if pair_curves(run_data, 1):
        kinds += ["separation", "pairs"]
    if any(f.manoeuvre in AVOIDING for f in flown_commands(run_data)):
        kinds.append("commands")
    if resolutions(run_data, 1):
        kinds.append("candidates")
    scenario = run_data.scenario
    as_in_the_paper = scenario.resolver == "geometric" and not run_data.plan
    numbers = NUMBERS.get(scenario.name, {}) if as_in_the_paper else {}
    name = scenario.name
    return {k: f"figure_{numbers[k]:02d}" if k in numbers else f"{name}_{k}" for k in kinds}


def write_figures(
    run_data: RunData, names: dict[str, str], folder: Path, suffix: str, dpi: int
) -> None:
    """Draw the figures of these kinds to files of these names; raises OSError."""
    with rc_context(STYLE):
        for kind, name in names.items():
            figure = FIGURES[kind](run_data)
            save_figure(figure, folder / f"{name}.{suffix}", dpi, bbox_inches="tight")


def separation_figure(run_data: RunData) -> Figure:
    """Distances of the pair that came nearest, and its risk (figures 3 and 6)."""
    pair = pair_curves(run_data, 1)[0]
    need = run_data.scenario.required_of(pair.minimum.pair)
    figure, (level, height, risk) = panels((6.2, 4.6), [3.0, 2.0, 0.8])
    braided(level, pair, pair.horizontal_m)
    braided(height, pair, pair.vertical_m)
    required(level, need.horizontal_m, f"required {need.horizontal_m:g} m")
    required(height, need.vertical_m, f"required {need.vertical_m:g} m")
    for axes in (level, height, risk):
        axes.axvline(pair.minimum.t_s, color=GREY, linewidth=0.9, linestyle=":")
    end = window_s(run_data)
    seen = pair.times_s <= end
    level.set_ylim(0.0, 1.05 * float(np.nanmax(pair.horizontal_m[seen])))
    top = max(float(np.nanmax(pair.vertical_m[seen])), 1.25 * need.vertical_m)
    height.set_ylim(-0.04 * top, 1.1 * top)
    level.set_ylabel("Horizontal (m)")
    height.set_ylabel("Vertical (m)")
    found = risks(run_data).get(pair.ids)
    risk.fill_between(*boolean(found.flown if found else [], run_data.end_s), color="#8a94a0", lw=0)
    risk.plot(*boolean(found.planned if found else [], run_data.end_s), color=INK, linewidth=1.4)
    risk.set_yticks([0, 1], ["false", "true"])
    risk.set_ylim(-0.15, 1.3)
    risk.set_ylabel("Risk")
    risk.set_xlim(0.0, end)
    risk.set_xlabel("Time (s)")
    a, b = pair.ids
    level.set_title(
        f"UAV {a} and UAV {b}: least {pair.least_text} of required, at {pair.minimum.t_s:.1f} s"
    )
    return figure


def commands_figure(run_data: RunData) -> Figure:
    """What was commanded and what came of it (figures 4 and 7)."""
    flown = flown_commands(run_data)
    turned = [f for f in flown if f.manoeuvre in TURNING]
    climbed = [f for f in flown if f.manoeuvre in CLIMBING]
    paced = [f for f in flown if f.manoeuvre == Manoeuvre.SPEED]
    drawn: list[Callable[[Axes], None]] = []
    if turned:
        drawn.append(lambda axes: _stepped(axes, turned, "Turn $t_c$ (°)", _turn_deg))
    if turned and not climbed:
        drawn.append(lambda axes: _headings(axes, run_data, turned))
    if climbed:
        drawn.append(lambda axes: _stepped(axes, climbed, "Climb $c_c$ (m/s)", _climb_mps))
        drawn.append(lambda axes: _altitudes(axes, run_data, climbed))
    if paced:
        drawn.append(lambda axes: _speeds(axes, run_data, paced))
    figure, rows = panels((6.2, 1.0 + 1.7 * len(drawn)), [1.0] * len(drawn))
    for draw, axes in zip(drawn, rows, strict=True):
        draw(axes)
    rows[-1].set_xlim(0.0, window_s(run_data))
    rows[-1].set_xlabel("Time (s)")
    rows[0].set_title("Commanded, and flown")
    if len({f.uav for f in flown}) <= MOST_NAMED:
        named: dict[str, Any] = {}
        for axes in rows:
            handles, labels = axes.get_legend_handles_labels()
            named |= dict(zip(labels, handles, strict=True))
        ordered = sorted(named, key=lambda label: int(label.split()[1]))
        handles = [named[label] for label in ordered]
        figure.legend(handles, ordered, ncols=6, loc="outside lower center")
    return figure


def trajectories_figure(run_data: RunData) -> Figure:
    """The paths in space, and the protected zones when two were nearest (figures 5, 8 and 9)."""
    figure = Figure(figsize=(6.2, 4.9))
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    end = window_s(run_data)
    at_s = nearest_s(run_data)
    shown = run_data.at(end) + 1
    ground = ground_m(run_data, shown)
    for flight in run_data.flights:
        ned = flight.ned_m[:shown]
        look = {"color": colour_of(flight.index), "zorder": 4}
        axes.plot(ned[:, 1], ned[:, 0], -ned[:, 2], lw=1.8, label=f"UAV {flight.id}", **look)
        axes.plot(ned[:, 1], ned[:, 0], ground, color=PALE, lw=0.8, zorder=1)
        marks = [run_data.at(t) for t in np.arange(0.0, end + 1e-6, TICK_S)]
        axes.plot(ned[marks, 1], ned[marks, 0], -ned[marks, 2], ".", ms=4, **look)
        zone = run_data.scenario.zone_of(flight.id)
        draw_zone(axes, zone, flight.ned_m[run_data.at(at_s)], colour_of(flight.index))
        start = ned[0]
        if len(run_data.flights) <= 12 and np.isfinite(start[0]):
            axes.text(start[1], start[0], -start[2], f" {flight.id}", zorder=6, fontweight="bold")
    space(axes)
    axes.set_title(
        f"Paths to {end:.0f} s, dots every {TICK_S:.0f} s, protected zones at {at_s:.1f} s", y=0.99
    )
    if len(run_data.flights) <= MOST_NAMED:
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, 0.93), ncols=1)
    return figure


def plan_figure(run_data: RunData) -> Figure:
    """The paths from above, bold where a command was in force."""
    figure = Figure(figsize=(5.6, 5.4), layout="constrained")
    axes = figure.add_subplot()
    shown = run_data.at(window_s(run_data)) + 1
    for flight in run_data.flights:
        ned, colour = flight.ned_m[:shown], colour_of(flight.index)
        axes.plot(ned[:, 1], ned[:, 0], color=colour, lw=1.5, path_effects=rim(colour))
        if np.isfinite(ned[0, 0]):
            at = (float(ned[0, 1]), float(ned[0, 0]))
            look: dict[str, Any] = {"fontsize": 8, "fontweight": "bold", "path_effects": HALO}
            axes.annotate(str(flight.id), at, **look)
    flights = {f.id: f for f in run_data.flights}
    for flown in flown_commands(run_data):
        part = slice(run_data.at(flown.start_s), min(run_data.at(flown.end_s) + 1, shown))
        ned = flights[flown.uav].ned_m[part]
        axes.plot(ned[:, 1], ned[:, 0], color=colour_of(flown.index), lw=3.6)
    for flight in run_data.flights:
        for first, last in true_spans(flight.modes[:shown] == Mode.UNMANNED):
            ned = flight.ned_m[first : last + 1]
            axes.plot(ned[:, 1], ned[:, 0], color="white", lw=2.2)
            axes.plot(ned[:, 1], ned[:, 0], color=GREY, lw=1.5, linestyle=(0, (4, 3)))
            axes.plot(ned[0, 1], ned[0, 0], "x", color=GREY, ms=7, mew=2)
    axes.set_aspect("equal")
    axes.margins(0.06)
    broad(axes)
    axes.set_xlabel("East (m)")
    axes.set_ylabel("North (m)")
    axes.set_title("Plan view; wide: a command in force")
    return figure


def pairs_figure(run_data: RunData) -> Figure:
    """Separation of all pairs (figure 10)."""
    curves, need = pair_curves(run_data, PAIRS_AT_ALL), run_data.scenario.required()
    figure, (level, normalised) = panels((6.2, 5.0), [1.0, 1.3])
    for pair in reversed(curves):
        for axes, values in ((level, pair.horizontal_m), (normalised, pair.normalised)):
            if pair in curves[:PAIRS_IN_COLOUR]:
                braided(axes, pair, values)
            else:
                axes.plot(pair.times_s, values, color=PALE, lw=0.7, zorder=1)
    end = window_s(run_data)
    least = " at least" if run_data.scenario.zone_ratios().larger else ""
    required(
        level,
        need.horizontal_m,
        f"required{least} {need.horizontal_m:g} m (or {need.vertical_m:g} m in height)",
    )
    required(normalised, 1.0, "required")
    level.set_ylim(0.0, 10.0 * need.horizontal_m)
    normalised.set_ylim(0.0, 4.0)
    level.set_ylabel("Horizontal (m)")
    normalised.set_ylabel("Separation / required")
    normalised.set_xlim(0.0, end)
    normalised.set_xlabel("Time (s)")
    count = len(run_data.flights) * (len(run_data.flights) - 1) // 2
    which = f"{len(curves)} of {count} pairs" if len(curves) < count else "all pairs"
    which = "the only pair" if count == 1 else which
    level.set_title(f"Separation of {which}: least {curves[0].least_text} of required")
    _name_minima(normalised, curves[:PAIRS_IN_COLOUR], end)
    return figure


def candidates_figure(run_data: RunData) -> Figure:
    """The candidates of the first decision in space, safe and not, and the one chosen."""
    decided = resolutions(run_data, 1)[0]
    place, others = {f.id: f.index for f in run_data.flights}, decided.near
    figure = Figure(figsize=(6.2, 4.9))
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    for candidate in (*decided.candidates, decided.chosen):
        draw_candidate(axes, candidate, colour_of(place[decided.target]))
    for uav, path in others.items():
        look = {"color": colour_of(place[uav]), "lw": 1.8, "label": f"UAV {uav}", "zorder": 4}
        axes.plot(path[:, 1], path[:, 0], -path[:, 2], **look)
    space(axes)
    rest = "candidates in red are not safe" if decided.candidates else "no candidates logged"
    told = f"UAV {decided.target} at {decided.time_s:.1f} s: {decided.chosen.words} (bold)"
    axes.set_title(f"{told}; {rest}", y=0.99)
    if len(others) <= MOST_NAMED:
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, 0.93))
    return figure


def window_s(run_data: RunData) -> float:
    """Until when figures are drawn: a while after the last command and the nearest moment."""
    ends = [f.end_s for f in flown_commands(run_data)]
    return min(run_data.end_s, max([nearest_s(run_data), *ends]) + AFTER_S)


def nearest_s(run_data: RunData) -> float:
    """When any two were nearest."""
    return run_data.minima[0].t_s if run_data.minima else 0.0


FIGURES: dict[str, Callable[[RunData], Figure]] = {
    "separation": separation_figure,
    "commands": commands_figure,
    "trajectories": trajectories_figure,
    "plan": plan_figure,
    "pairs": pairs_figure,
    "candidates": candidates_figure,
}


def _turn_deg(flown: FlownCommand) -> float:
    return math.degrees(flown.turn_rad)


def _climb_mps(flown: FlownCommand) -> float:
    return flown.climb_mps


def _stepped(
    axes: Axes, flown: Sequence[FlownCommand], words: str, value: Callable[[FlownCommand], float]
) -> None:
    for uav, index in sorted({(f.uav, f.index) for f in flown}):
        mine = [f for f in flown if f.uav == uav]
        x, y = steps(mine, [value(f) for f in mine])
        axes.plot(x, y, lw=2.0, label=f"UAV {uav}", **flying(index))
    axes.axhline(0.0, color=GREY, lw=0.8, zorder=1)
    axes.margins(y=0.15)
    axes.set_ylabel(words)


def _headings(axes: Axes, run_data: RunData, flown: Sequence[FlownCommand]) -> None:
    told = {f.uav for f in flown}
    for flight in run_data.flights:
        if flight.id in told:
            turned = np.degrees(np.unwrap(flight.heading_rad - flight.heading_rad[0]))
            axes.plot(run_data.times_s, turned, lw=1.8, **flying(flight.index))
    axes.axhline(0.0, color=GREY, lw=0.8, zorder=1)
    axes.set_ylabel("Change of heading\nflown (°)")


def _speeds(axes: Axes, run_data: RunData, flown: Sequence[FlownCommand]) -> None:
    told = {f.uav for f in flown}
    for flight in run_data.flights:
        if flight.id in told:
            look = {"label": f"UAV {flight.id}", **flying(flight.index)}
            axes.plot(run_data.times_s, flight.speed_mps, lw=2.0, **look)
    axes.set_ylabel("Speed (m/s)")


def _altitudes(axes: Axes, run_data: RunData, flown: Sequence[FlownCommand]) -> None:
    told = {f.uav for f in flown}
    for flight in sorted(run_data.flights, key=lambda f: f.id in told):
        bold = flight.id in told
        look: dict[str, Any] = {"color": PALE, "lw": 0.9}
        look = {"lw": 1.8, **flying(flight.index)} if bold else look
        axes.plot(run_data.times_s, -flight.ned_m[:, 2], **look)
    axes.set_ylabel("Altitude (m)")


def _name_minima(axes: Axes, curves: Sequence[DrawnPair], end_s: float) -> None:
    taken = [-math.inf] * 4
    for pair in sorted(curves, key=lambda p: p.nearest):
        at = pair.minimum.t_s
        if pair.least > 4.0 or at > end_s:
            continue
        row = next((n for n, until in enumerate(taken) if at > until), taken.index(min(taken)))
        taken[row] = at + 0.09 * end_s
        look = {"arrowstyle": "-", "color": GREY, "lw": 0.7}
        place = (at, 0.8 - 0.2 * row)
        text = pair.label
        told = axes.annotate(
            text, (at, pair.least), place, fontsize=8, ha="center", va="top", arrowprops=look
        )
        told.set_path_effects(HALO)
