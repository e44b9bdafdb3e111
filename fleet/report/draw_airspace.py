"""The airspace: plan view and 3-D view of the flights, with protected zones that move with time."""

from __future__ import annotations

import numpy as np

from fleet.analysis.palette import colour_of
from fleet.model.types import Array
from fleet.model.words import Mode
from fleet.report.curves import flown_commands, kept, true_spans
from fleet.report.plot import (
    FEW_LINES,
    GREY,
    GRID,
    PALE,
    Chart,
    Json,
    axis,
    figure_layout,
    joined,
    line,
    line3,
    packed,
)
from fleet.report.run_data import Flight, RunData

PATH_M = 0.5
"""How far a drawn path may be from the logged one, at any time."""
NARROWEST = 0.5
"""The airspace drawn is at least so wide, relative to its length."""
VERTICAL = 0.42
"""Height of the 3-D box relative to its longer side."""


def path(run_data: RunData, flight: Flight) -> tuple[Array, Array]:
    """Times and NED positions of the logged states that are drawn."""
    some = kept(run_data.times_s, flight.ned_m, PATH_M)
    return run_data.times_s[some], flight.ned_m[some]


def planned_route(flight: Flight) -> Array:
    """Start and waypoints, as planned (n, 3)."""
    return np.array([flight.uav.position_ned_m, *flight.uav.waypoints_ned_m])


def moving(run_data: RunData) -> Json:
    """What the page's script needs to show everybody at any time."""
    uavs = []
    for flight in run_data.flights:
        zone = run_data.scenario.zone_of(flight.id)
        times, ned = path(run_data, flight)
        columns = {"t": times, "n": ned[:, 0], "e": ned[:, 1], "u": -ned[:, 2]}
        look = {"id": flight.id, "colour": colour_of(flight.index)}
        size = {"radius_m": zone.radius_m, "half_height_m": zone.half_height_m}
        uavs.append({**look, **size, **{name: packed(values) for name, values in columns.items()}})
    return {
        "end_s": run_data.end_s,
        "tick_s": run_data.scenario.tick_s,
        "uavs": uavs,
    }


def extent(run_data: RunData) -> tuple[Array, Array]:
    """Least and greatest NED coordinates flown, with room for the zones."""
    flown = np.concatenate([f.ned_m for f in run_data.flights])
    flown = flown[np.isfinite(flown[:, 0])]
    if not len(flown):
        flown = np.array([f.uav.position_ned_m for f in run_data.flights])
    zones = [run_data.scenario.zone_of(f.id) for f in run_data.flights]
    room = 1.25 * np.array([(z.radius_m, z.radius_m, z.half_height_m) for z in zones]).max(axis=0)
    low, high = flown.min(axis=0) - room, flown.max(axis=0) + room
    narrow = NARROWEST * (high - low)[:2].max() - (high - low)[:2]
    low[:2] -= np.maximum(narrow, 0.0) / 2.0
    high[:2] += np.maximum(narrow, 0.0) / 2.0
    return np.asarray(low), np.asarray(high)


def plan_chart(run_data: RunData) -> Chart:
    """The view from above."""
    traces = [_routes(run_data)]
    named = len(run_data.flights) <= FEW_LINES
    for flight in run_data.flights:
        _, ned = path(run_data, flight)
        look: Json = {
            "name": f"UAV {flight.id}",
            "legendgroup": str(flight.id),
            "showlegend": named,
        }
        hover = f"UAV {flight.id}<br>%{{x:.0f}} m E, %{{y:.0f}} m N<extra></extra>"
        colour = colour_of(flight.index)
        traces.append(line(ned[:, 1], ned[:, 0], colour, 2.0, hovertemplate=hover, **look))
    traces += _manoeuvres(run_data)
    traces += _unmanned(run_data)
    traces.append(_labels("scatter", run_data))
    low, high = extent(run_data)
    return Chart(
        "plan",
        "Plan view",
        "Lines are paths flown, twice as wide where a command was in force (light colours have a "
        "dark rim), dotted as planned; grey dashes: nobody flies it any more, from the cross on. "
        "A cross at the end: it has vanished. Discs are "
        "the protected zones at the time of the slider. Where separation is lost, in height too, "
        "they turn red.",
        traces,
        figure_layout(
            560,
            xaxis=axis("East (m)", range=[low[1], high[1]], constrain="domain", tickformat="d"),
            yaxis=axis(
                "North (m)",
                range=[low[0], high[0]],
                scaleanchor="x",
                constrain="domain",
                tickformat="d",
            ),
            showlegend=named,
        ),
        560,
        "plan",
    )


def scene_chart(run_data: RunData) -> Chart:
    """The view in space."""
    low, high = extent(run_data)
    traces = [_shadows(run_data, -float(high[2]))]
    named = len(run_data.flights) <= FEW_LINES
    for flight in run_data.flights:
        _, ned = path(run_data, flight)
        look: Json = {"name": f"UAV {flight.id}", "showlegend": named}
        hover = f"UAV {flight.id}<br>%{{x:.0f}} m E, %{{y:.0f}} m N, %{{z:.0f}} m up<extra></extra>"
        traces.append(line3(ned, colour_of(flight.index), 5.0, hovertemplate=hover, **look))
        for first, last in true_spans(flight.modes == Mode.UNMANNED):
            dead = flight.ned_m[first : last + 1]
            more: Json = {"hoverinfo": "skip", "showlegend": False}
            traces.append(line3(dead, GREY, 7.0, **more))
    traces.append({"type": "mesh3d", "x": [], "y": [], "z": [], "hoverinfo": "skip"})
    traces.append(_labels("scatter3d", run_data))
    wide = max(high[0] - low[0], high[1] - low[1])
    times = VERTICAL * wide / (high[2] - low[2])
    return Chart(
        "scene",
        "In space",
        f"Drag to turn, scroll to zoom. Heights are drawn {times:.0f} times larger than distances; "
        "thin grey lines are the paths on the ground, thick ones of what nobody flies.",
        traces,
        figure_layout(
            560, scene=scene(low, high), showlegend=named, margin={"l": 0, "r": 0, "t": 0, "b": 0}
        ),
        560,
        "scene",
    )


def scene(low: Array, high: Array) -> Json:
    """Axes of a 3-D figure that spans these NED coordinates."""
    wide = max(high[0] - low[0], high[1] - low[1])
    look: Json = {
        "gridcolor": GRID,
        "zeroline": False,
        "showbackground": True,
        "backgroundcolor": "#fafbfc",
        "linecolor": PALE,
        "tickfont": {"size": 11},
        "tickformat": "d",
        "nticks": 6,
    }
    return {
        "xaxis": {**look, "title": {"text": "East (m)"}, "range": [low[1], high[1]]},
        "yaxis": {**look, "title": {"text": "North (m)"}, "range": [low[0], high[0]]},
        "zaxis": {**look, "title": {"text": "Altitude (m)"}, "range": [-high[2], -low[2]]},
        "aspectmode": "manual",
        "aspectratio": {
            "x": 1.25 * (high[1] - low[1]) / wide,
            "y": 1.25 * (high[0] - low[0]) / wide,
            "z": VERTICAL,
        },
        "camera": {
            "eye": {"x": -0.9, "y": -1.6, "z": 0.95},
            "center": {"x": 0, "y": 0, "z": -0.16},
        },
    }


def _routes(run_data: RunData) -> Json:
    ned = joined([planned_route(f) for f in run_data.flights])
    return line(ned[:, 1], ned[:, 0], PALE, 1.4, "dot", name="planned", hoverinfo="skip")


def _shadows(run_data: RunData, ground_m: float) -> Json:
    ned = joined([path(run_data, f)[1] for f in run_data.flights])
    ned[:, 2] = np.where(np.isnan(ned[:, 0]), np.nan, -ground_m)
    return line3(ned, PALE, 2.0, hoverinfo="skip", showlegend=False)


def _manoeuvres(run_data: RunData) -> list[Json]:
    """The parts of the paths on which a command was in force, drawn bold."""
    out = []
    flights = {f.id: f for f in run_data.flights}
    for flown in flown_commands(run_data):
        flight = flights[flown.uav]
        first, last = run_data.at(flown.start_s), run_data.at(flown.end_s)
        times, ned = run_data.times_s[first : last + 1], flight.ned_m[first : last + 1]
        some = kept(times, ned, PATH_M)
        more: Json = {"showlegend": False, "legendgroup": str(flight.id)}
        more["hovertemplate"] = f"UAV {flown.uav}: {flown.words}<extra></extra>"
        colour = colour_of(flown.index)
        out.append(line(ned[some, 1], ned[some, 0], colour, 5.0, **more))
    return out


def _unmanned(run_data: RunData) -> list[Json]:
    """Where nobody flies an aircraft any more: a cross there, and what it flies on, in grey."""
    out, crosses = [], list[Array]()
    for flight in run_data.flights:
        for first, last in true_spans(flight.modes == Mode.UNMANNED):
            ned = flight.ned_m[first : last + 1]
            some = kept(run_data.times_s[first : last + 1], ned, PATH_M)
            more: Json = {"showlegend": False, "legendgroup": str(flight.id)}
            more["hovertemplate"] = f"UAV {flight.id}: unmanned<extra></extra>"
            out.append(line(ned[some, 1], ned[some, 0], "#ffffff", 3.0, "solid", **more))
            out.append(line(ned[some, 1], ned[some, 0], GREY, 2.0, "dash", **more))
            crosses.append(ned[0])
        there = np.flatnonzero(np.isfinite(flight.ned_m[:, 0]))
        if flight.id in run_data.vanished and len(there):
            crosses.append(flight.ned_m[there[-1]])
    if crosses:
        ned = np.array(crosses)
        look: Json = {"mode": "markers", "hoverinfo": "skip", "showlegend": False}
        marker = {"symbol": "x", "size": 11, "color": GREY}
        out.append({**line(ned[:, 1], ned[:, 0], GREY, **look), "marker": marker})
    return out


def _labels(kind: str, run_data: RunData) -> Json:
    """Where everybody is; the script moves it."""
    return {
        "type": kind,
        "mode": "markers+text",
        "x": [],
        "y": [],
        **({"z": []} if kind == "scatter3d" else {}),
        "text": [str(f.id) for f in run_data.flights],
        "textposition": "top center",
        "textfont": {"size": 12 if len(run_data.flights) <= FEW_LINES else 10},
        "marker": {
            "size": 9 if kind == "scatter" else 5,
            "color": [colour_of(f.index) for f in run_data.flights],
            "line": {"color": "#22272e", "width": 1},
        },
        "hoverinfo": "skip",
        "showlegend": False,
    }
