"""The airspace: plan view and 3-D view of the flights, with protected zones that move with time."""

from __future__ import annotations

import numpy as np

from fleet.analysis.palette import colour_of
from fleet.model.trajectory import Array
from fleet.report.curves import flown_commands, kept, runs
from fleet.report.plot import (
    FEW,
    GREY,
    GRID,
    PALE,
    Chart,
    Json,
    axis,
    joined,
    layout,
    line,
    line3,
    packed,
)
from fleet.report.story import Flight, Story

PATH_M = 0.5
"""How far a drawn path may be from the logged one, at any time."""
NARROWEST = 0.5
"""The airspace drawn is at least so wide, relative to its length."""
VERTICAL = 0.42
"""Height of the 3-D box relative to its longer side."""


def path(story: Story, flight: Flight) -> tuple[Array, Array]:
    """Times and NED positions of the logged states that are drawn."""
    some = kept(story.times_s, flight.ned_m, PATH_M)
    return story.times_s[some], flight.ned_m[some]


def route(flight: Flight) -> Array:
    """Start and waypoints, as planned (n, 3)."""
    return np.array([flight.uav.position_ned_m, *flight.uav.waypoints_ned_m])


def moving(story: Story) -> Json:
    """What the page's script needs to show everybody at any time."""
    zone = story.scenario.zone
    uavs = []
    for flight in story.flights:
        times, ned = path(story, flight)
        columns = {"t": times, "n": ned[:, 0], "e": ned[:, 1], "u": -ned[:, 2]}
        look = {"id": flight.id, "colour": colour_of(flight.index)}
        uavs.append({**look, **{name: packed(values) for name, values in columns.items()}})
    return {
        "end_s": story.end_s,
        "tick_s": story.scenario.tick_s,
        "radius_m": zone.radius_m,
        "half_height_m": zone.half_height_m,
        "uavs": uavs,
    }


def extent(story: Story) -> tuple[Array, Array]:
    """Least and greatest NED coordinates flown, with room for the zones."""
    flown = np.concatenate([f.ned_m for f in story.flights])
    flown = flown[np.isfinite(flown[:, 0])]
    if not len(flown):
        flown = np.array([f.uav.position_ned_m for f in story.flights])
    zone = story.scenario.zone
    room = np.array([zone.radius_m, zone.radius_m, zone.half_height_m]) * 1.25
    low, high = flown.min(axis=0) - room, flown.max(axis=0) + room
    narrow = NARROWEST * (high - low)[:2].max() - (high - low)[:2]
    low[:2] -= np.maximum(narrow, 0.0) / 2.0
    high[:2] += np.maximum(narrow, 0.0) / 2.0
    return np.asarray(low), np.asarray(high)


def plan_chart(story: Story) -> Chart:
    """The view from above."""
    traces = [_routes(story)]
    named = len(story.flights) <= FEW
    for flight in story.flights:
        _, ned = path(story, flight)
        look: Json = {
            "name": f"UAV {flight.id}",
            "legendgroup": str(flight.id),
            "showlegend": named,
        }
        hover = f"UAV {flight.id}<br>%{{x:.0f}} m E, %{{y:.0f}} m N<extra></extra>"
        colour = colour_of(flight.index)
        traces.append(line(ned[:, 1], ned[:, 0], colour, 2.0, hovertemplate=hover, **look))
    traces += _escapes(story)
    traces += _unmanned(story)
    traces.append(_labels("scatter", story))
    low, high = extent(story)
    return Chart(
        "plan",
        "Plan view",
        "Lines are paths flown, twice as wide where a command was in force (light colours have a "
        "dark rim), dotted as planned; grey dashes: nobody flies it any more, from the cross on. "
        "A cross at the end: it has vanished. Discs are "
        "the protected zones at the time of the slider. Where separation is lost, in height too, "
        "they turn red.",
        traces,
        layout(
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


def scene_chart(story: Story) -> Chart:
    """The view in space."""
    low, high = extent(story)
    traces = [_shadows(story, -float(high[2]))]
    named = len(story.flights) <= FEW
    for flight in story.flights:
        _, ned = path(story, flight)
        look: Json = {"name": f"UAV {flight.id}", "showlegend": named}
        hover = f"UAV {flight.id}<br>%{{x:.0f}} m E, %{{y:.0f}} m N, %{{z:.0f}} m up<extra></extra>"
        traces.append(line3(ned, colour_of(flight.index), 5.0, hovertemplate=hover, **look))
        for first, last in runs(flight.modes == "unmanned"):
            dead = flight.ned_m[first : last + 1]
            more: Json = {"hoverinfo": "skip", "showlegend": False}
            traces.append(line3(dead, GREY, 7.0, **more))
    traces.append({"type": "mesh3d", "x": [], "y": [], "z": [], "hoverinfo": "skip"})
    traces.append(_labels("scatter3d", story))
    wide = max(high[0] - low[0], high[1] - low[1])
    times = VERTICAL * wide / (high[2] - low[2])
    return Chart(
        "scene",
        "In space",
        f"Drag to turn, scroll to zoom. Heights are drawn {times:.0f} times larger than distances; "
        "thin grey lines are the paths on the ground, thick ones of what nobody flies.",
        traces,
        layout(
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


def _routes(story: Story) -> Json:
    ned = joined([route(f) for f in story.flights])
    return line(ned[:, 1], ned[:, 0], PALE, 1.4, "dot", name="planned", hoverinfo="skip")


def _shadows(story: Story, ground_m: float) -> Json:
    ned = joined([path(story, f)[1] for f in story.flights])
    ned[:, 2] = np.where(np.isnan(ned[:, 0]), np.nan, -ground_m)
    return line3(ned, PALE, 2.0, hoverinfo="skip", showlegend=False)


def _escapes(story: Story) -> list[Json]:
    """The parts of the paths on which a command was in force, drawn bold."""
    out = []
    flights = {f.id: f for f in story.flights}
    for flown in flown_commands(story):
        flight = flights[flown.uav]
        first, last = story.at(flown.start_s), story.at(flown.end_s)
        times, ned = story.times_s[first : last + 1], flight.ned_m[first : last + 1]
        some = kept(times, ned, PATH_M)
        more: Json = {"showlegend": False, "legendgroup": str(flight.id)}
        more["hovertemplate"] = f"UAV {flown.uav}: {flown.words}<extra></extra>"
        colour = colour_of(flown.index)
        out.append(line(ned[some, 1], ned[some, 0], colour, 5.0, **more))
    return out


def _unmanned(story: Story) -> list[Json]:
    """Where nobody flies an aircraft any more: a cross there, and what it flies on, in grey."""
    out, crosses = [], list[Array]()
    for flight in story.flights:
        for first, last in runs(flight.modes == "unmanned"):
            ned = flight.ned_m[first : last + 1]
            some = kept(story.times_s[first : last + 1], ned, PATH_M)
            more: Json = {"showlegend": False, "legendgroup": str(flight.id)}
            more["hovertemplate"] = f"UAV {flight.id}: unmanned<extra></extra>"
            out.append(line(ned[some, 1], ned[some, 0], "#ffffff", 3.0, "solid", **more))
            out.append(line(ned[some, 1], ned[some, 0], GREY, 2.0, "dash", **more))
            crosses.append(ned[0])
        there = np.flatnonzero(np.isfinite(flight.ned_m[:, 0]))
        if flight.id in story.vanished and len(there):
            crosses.append(flight.ned_m[there[-1]])
    if crosses:
        ned = np.array(crosses)
        look: Json = {"mode": "markers", "hoverinfo": "skip", "showlegend": False}
        marker = {"symbol": "x", "size": 11, "color": GREY}
        out.append({**line(ned[:, 1], ned[:, 0], GREY, **look), "marker": marker})
    return out


def _labels(kind: str, story: Story) -> Json:
    """Where everybody is; the script moves it."""
    return {
        "type": kind,
        "mode": "markers+text",
        "x": [],
        "y": [],
        **({"z": []} if kind == "scatter3d" else {}),
        "text": [str(f.id) for f in story.flights],
        "textposition": "top center",
        "textfont": {"size": 12 if len(story.flights) <= FEW else 10},
        "marker": {
            "size": 9 if kind == "scatter" else 5,
            "color": [colour_of(f.index) for f in story.flights],
            "line": {"color": "#22272e", "width": 1},
        },
        "hoverinfo": "skip",
        "showlegend": False,
    }
