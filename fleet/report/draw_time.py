"""Curves against time: a pair's separation and risk, all pairs, commands and altitudes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fleet.analysis.palette import colour_of
from fleet.model.types import Array, Pair
from fleet.model.words import CLIMBING, Manoeuvre
from fleet.report.curves import DrawnPair, FlownCommand, Interval, flown_commands, kept, steps
from fleet.report.plot import (
    FEW_LINES,
    GREY,
    INK,
    PALE,
    Chart,
    Json,
    PickableContent,
    axis,
    below,
    braid,
    dash_of,
    figure_layout,
    joined,
    level_line,
    line,
    time_axis,
)
from fleet.report.risk import Risk
from fleet.report.run_data import RunData

PAIRS_TO_PICK = 30
PAIRS_IN_COLOUR = 12
METRES, SHARE = 1.0, 0.01
"""How far a drawn curve may be from the logged one."""


def pair_chart(run_data: RunData, pairs: Sequence[DrawnPair], risks: Mapping[Pair, Risk]) -> Chart:
    """Distances of one pair with what is required, and the Boolean risk (figures 3 and 6)."""
    shared = time_axis(run_data.end_s)
    hidden = {**shared, "matches": "x", "showticklabels": False, "title": {"text": ""}}
    figure = figure_layout(
        520,
        xaxis={**hidden, "matches": None, "anchor": "y"},
        xaxis2={**hidden, "anchor": "y2"},
        xaxis3={**shared, "matches": "x", "anchor": "y3"},
        yaxis2=axis("Vertical (m)", domain=[0.2, 0.5], rangemode="tozero"),
        yaxis3=axis(
            "Risk", domain=[0.0, 0.13], range=[-0.1, 1.25], tickvals=[0, 1], ticktext=["no", "yes"]
        ),
    )
    choices = [
        PickableContent(
            _pair_name(p),
            _pair_traces(run_data, p, risks.get(p.ids)),
            _pair_layout(run_data, p),
            _pair_words(p),
        )
        for p in pairs[:PAIRS_TO_PICK]
    ]
    return Chart(
        "pair",
        "Separation and risk of a pair",
        "Separation is kept while at least one of both distances is as large as required. Risk "
        "(eq. 9) is whether the predicted zones overlap within T<sub>s</sub>: filled, as both fly; "
        "as a line, as they would if guidance were followed, which is what ends a manoeuvre.",
        choices[0].traces if choices else [],
        figure,
        520,
        "cursor",
        choices,
        "Pair",
    )


def _pair_layout(run_data: RunData, pair: DrawnPair) -> Json:
    """What is required of a pair, when it was nearest, and how far up its distances are drawn."""
    required = run_data.scenario.required_of(pair.minimum.pair)
    shapes, words = zip(
        level_line(required.horizontal_m, f"required {required.horizontal_m:g} m"),
        level_line(required.vertical_m, f"required {required.vertical_m:g} m", "2"),
        strict=True,
    )
    tints = [below(required.horizontal_m), below(required.vertical_m, "2")]
    return {
        "shapes": [*shapes, *tints, _nearest(pair)],
        "annotations": list(words),
        "yaxis": axis(
            "Horizontal (m)", domain=[0.56, 1.0], tickformat="d", range=[0.0, _top_m(pair)]
        ),
    }


def _pair_name(pair: DrawnPair) -> str:
    lost = " (lost)" if pair.least < 1.0 else ""
    return f"{pair.label}, least {pair.least_text}{lost}"


def _top_m(pair: DrawnPair) -> float:
    """Where the axis of horizontal distances ends: all of the approach is to be seen."""
    return 1.04 * max(float(np.nanmax(pair.horizontal_m[: pair.nearest + 1])), 1200.0)


def _nearest(pair: DrawnPair) -> Json:
    """A line through all panels at the moment at which a pair was nearest."""
    at = pair.minimum.t_s
    line_look = {"color": GREY, "width": 1.2, "dash": "dot"}
    return {
        "type": "line",
        "xref": "x",
        "yref": "paper",
        "x0": at,
        "x1": at,
        "y0": 0,
        "y1": 1,
        "line": line_look,
        "layer": "below",
    }


def _pair_words(pair: DrawnPair) -> str:
    nearest = pair.minimum
    return (
        f"Nearest at {nearest.t_s:.1f} s (dotted): {pair.least_text} of required, "
        f"{nearest.horizontal_m:.0f} m horizontally and {nearest.vertical_m:.1f} m vertically."
    )


def _pair_traces(run_data: RunData, pair: DrawnPair, risk: Risk | None) -> list[Json]:
    indices = pair.a.index, pair.b.index
    traces: list[Json] = []
    for n, values in enumerate((pair.horizontal_m, pair.vertical_m)):
        some = pair.kept(values, METRES if n == 0 else 0.2)
        row: Json = {"xaxis": "x2", "yaxis": "y2"} if n else {}
        hover = "%{y:.0f} m at %{x:.1f} s<extra></extra>"
        traces += braid(
            pair.times_s[some],
            values[some],
            indices,
            name=f"UAV {pair.a.id} to UAV {pair.b.id}",
            hovertemplate=hover,
            showlegend=False,
            **row,
        )
    place: Json = {"xaxis": "x3", "yaxis": "y3", "showlegend": False}
    flown, planned = (risk.flown, risk.planned) if risk else ([], [])
    hover = "%{y} at %{x:.1f} s<extra>risk</extra>"
    filled = line(*boolean(flown, run_data.end_s), INK, 0.0, fill="tozeroy", **place)
    filled |= {"fillcolor": "#8a94a0", "hoverinfo": "skip"}
    return [
        *traces,
        filled,
        line(*boolean(planned, run_data.end_s), INK, 2.0, hovertemplate=hover, **place),
    ]


def boolean(spans: Sequence[Interval], end_s: float) -> tuple[Array, Array]:
    """A curve that is 1 in these intervals and else 0."""
    times, values = [0.0], [0.0]
    for start, end in spans:
        times += [start, start, end, end]
        values += [0.0, 1.0, 1.0, 0.0]
    return np.array([*times, end_s]), np.array([*values, 0.0])


def pairs_chart(run_data: RunData, pairs: Sequence[DrawnPair], all_pairs: int) -> Chart:
    """Separation of all pairs (figure 10)."""
    traces = list[Json]()
    drawn, rest = pairs[:PAIRS_IN_COLOUR], pairs[PAIRS_IN_COLOUR:]
    if rest:
        curves = [
            np.column_stack([p.times_s, p.normalised])[p.kept(p.normalised, SHARE)] for p in rest
        ]
        table = joined(curves)
        name = f"{len(rest)} other pairs"
        traces.append(line(table[:, 0], table[:, 1], PALE, 1.0, name=name, hoverinfo="skip"))
    for pair in reversed(drawn):
        some = pair.kept(pair.normalised, SHARE)
        hover = f"{pair.label}: %{{y:.2f}} at %{{x:.1f}} s<extra></extra>"
        look = {"showlegend": False, "hovertemplate": hover}
        indices = pair.a.index, pair.b.index
        traces += braid(pair.times_s[some], pair.normalised[some], indices, **look)
    shape, words = level_line(1.0, "required")
    shown = (
        f"the {len(pairs)} nearest of {all_pairs} pairs" if all_pairs > len(pairs) else "all pairs"
    )
    return Chart(
        "pairs",
        "Separation of all pairs",
        "Normalised: the greater of horizontal and vertical distance, each divided by what is "
        "required. Below 1 separation is lost. A line has the colours of both its UAVs. Shown are "
        f"{shown}; double-click for what is far apart.",
        traces,
        figure_layout(
            520,
            xaxis=time_axis(run_data.end_s),
            yaxis=axis("Separation / required", range=[0.0, 4.0]),
            shapes=[shape, below(1.0)],
            annotations=[words, *_minima(run_data, drawn)],
        ),
        520,
        "cursor",
    )


def _minima(run_data: RunData, pairs: Sequence[DrawnPair]) -> list[Json]:
    """The names of pairs below where each is nearest, on several lines where they are close."""
    out: list[Json] = []
    taken = [-math.inf] * 4
    for pair in sorted(pairs, key=lambda p: p.nearest):
        if pair.least > 4.0:
            continue
        at = pair.minimum.t_s
        row = next((n for n, until in enumerate(taken) if at > until), taken.index(min(taken)))
        taken[row] = at + 0.09 * run_data.end_s
        look = {"x": at, "y": pair.least, "ax": 0, "axref": "pixel", "arrowcolor": GREY}
        look |= {"ayref": "y", "ay": 0.86 - 0.2 * row, "arrowwidth": 1, "arrowhead": 0}
        out.append({**look, "text": pair.label, "font": {"size": 12}, "yanchor": "top"})
    return out


def commands_chart(run_data: RunData) -> Chart:
    """Commanded turn, commanded climb, and altitude (figures 4 and 7)."""
    flown = flown_commands(run_data)
    shared = time_axis(run_data.end_s)
    hidden = {**shared, "showticklabels": False, "title": {"text": ""}}
    named = len({f.uav for f in flown}) <= FEW_LINES
    paced = [f for f in flown if f.manoeuvre == Manoeuvre.SPEED]
    low = 0.26 if paced else 0.0
    more: Json = {}
    if paced:
        more["xaxis4"] = {**shared, "matches": "x", "anchor": "y4"}
        more["yaxis4"] = axis("Speed (m/s)", domain=[0.0, 0.18])
    return Chart(
        "commands",
        "Commands and altitude",
        "What was commanded and flown: the turn t<sub>c</sub> away from guidance's heading "
        "(positive to the right), the climb c<sub>c</sub>, and the altitude that came of it; the "
        "speed, if any was commanded. "
        "Nothing is drawn where guidance flies. UAVs that never had a command are grey.",
        [
            *(line([0.0, run_data.end_s], [0.0, 0.0], PALE, 1.0, **place) for place in _levels()),
            *_turns(flown),
            *_climbs(flown),
            *_altitudes(run_data, flown),
            *_speeds(run_data, paced),
        ],
        figure_layout(
            600,
            xaxis={**hidden, "anchor": "y"},
            xaxis2={**hidden, "matches": "x", "anchor": "y2"},
            xaxis3={**(hidden if paced else shared), "matches": "x", "anchor": "y3"},
            yaxis=axis("Turn (°)", domain=[0.72, 1.0], zeroline=True, zerolinecolor=GREY),
            yaxis2=axis("Climb (m/s)", domain=[0.42, 0.66], zeroline=True, zerolinecolor=GREY),
            yaxis3=axis("Altitude (m)", domain=[low, 0.36], tickformat="d"),
            **more,
            showlegend=named,
        ),
        600,
        "cursor",
    )


def _levels() -> list[Json]:
    """Where the lines at zero go: they are there when nobody was commanded, too."""
    look = {"hoverinfo": "skip", "showlegend": False}
    return [{"xaxis": f"x{n}", "yaxis": f"y{n}", **look} for n in ("", "2")]


def _turns(flown: Sequence[FlownCommand]) -> list[Json]:
    return _stepped(flown, "°", "", lambda f: math.degrees(f.turn_rad))


def _climbs(flown: Sequence[FlownCommand]) -> list[Json]:
    return _stepped(flown, " m/s", "2", lambda f: f.climb_mps * (f.manoeuvre in CLIMBING))


def _stepped(flown: Sequence[FlownCommand], unit: str, row: str, value: Any) -> list[Json]:
    out = []
    for uav, index in sorted({(f.uav, f.index) for f in flown}):
        mine = [f for f in flown if f.uav == uav]
        x, y = steps(mine, [value(f) for f in mine])
        if not np.nan_to_num(y).any():
            continue
        hover = f"UAV {uav}: %{{y:+.3g}}{unit} at %{{x:.1f}} s<extra></extra>"
        look = {"name": f"UAV {uav}", "legendgroup": str(uav), "showlegend": False}
        place = {"xaxis": f"x{row}", "yaxis": f"y{row}", **look}
        out.append(line(x, y, colour_of(index), 2.6, dash_of(index), hovertemplate=hover, **place))
    return out


def _speeds(run_data: RunData, flown: Sequence[FlownCommand]) -> list[Json]:
    """The speed of each UAV that was ever told one."""
    out, told = [], {f.uav for f in flown}
    for flight in run_data.flights:
        if flight.id in told:
            some = kept(run_data.times_s, flight.speed_mps, 0.02)
            hover = f"UAV {flight.id}: %{{y:.1f}} m/s at %{{x:.1f}} s<extra></extra>"
            look = {"name": f"UAV {flight.id}", "legendgroup": str(flight.id), "showlegend": False}
            look |= {"xaxis": "x4", "yaxis": "y4", "hovertemplate": hover}
            x, y = run_data.times_s[some], flight.speed_mps[some]
            out.append(line(x, y, colour_of(flight.index), 2.4, dash_of(flight.index), **look))
    return out


def _altitudes(run_data: RunData, flown: Sequence[FlownCommand]) -> list[Json]:
    out, told = [], {f.uav for f in flown}
    for flight in sorted(run_data.flights, key=lambda f: f.id in told):
        altitude = -flight.ned_m[:, 2]
        some = kept(run_data.times_s, altitude, 0.2)
        bold = flight.id in told
        colour, dash = (colour_of(flight.index), dash_of(flight.index)) if bold else (PALE, "solid")
        width = 2.4 if bold else 1.0
        hover = f"UAV {flight.id}: %{{y:.1f}} m at %{{x:.1f}} s<extra></extra>"
        look = {"name": f"UAV {flight.id}", "legendgroup": str(flight.id), "showlegend": bold}
        look |= {"xaxis": "x3", "yaxis": "y3"}
        x, y = run_data.times_s[some], altitude[some]
        out.append(line(x, y, colour, width, dash, hovertemplate=hover, **look))
    return out
