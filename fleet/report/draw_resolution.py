"""Resolution trajectories: the options of each decision in space (figures 5, 8 and 9)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fleet.analysis.palette import colour_of
from fleet.model.types import Array
from fleet.report.draw_airspace import scene
from fleet.report.plot import (
    ALERT,
    SAFE,
    Chart,
    Json,
    PickableContent,
    figure_layout,
    joined,
    line3,
    packed,
)
from fleet.report.resolution import DrawnCandidate, Resolved
from fleet.report.run_data import RunData


def resolution_chart(run_data: RunData, resolved: Sequence[Resolved]) -> Chart:
    """What each UAV could have been told, and was."""
    choices = [_choice(run_data, r) for r in resolved]
    first = choices[0] if choices else PickableContent("", [], {})
    return Chart(
        "resolution",
        "Resolution trajectories",
        "The options of the computing UAV over 2 T<sub>s</sub>, from the moment when the command "
        "starts: thin grey lines are safe, red ones are not (a diamond marks where they first meet "
        "a zone, margin included); the thick line was chosen. Others are drawn as they then flew. "
        "Predicted from the true states: with faults the computing UAV may have seen less.",
        first.traces,
        figure_layout(
            600, margin={"l": 0, "r": 0, "t": 0, "b": 0}, legend={"x": 0, "y": 1}, **first.layout
        ),
        600,
        "",
        choices,
        "Decision",
    )


def _choice(run_data: RunData, resolved: Resolved) -> PickableContent:
    e = resolved.encounter
    place = {f.id: f.index for f in run_data.flights}
    colour = colour_of(place[resolved.target])
    others = resolved.near
    safe = [c for c in resolved.candidates if c.safe and not c.chosen]
    unsafe = [c for c in resolved.candidates if not c.safe and not c.chosen]
    chosen = resolved.chosen
    traces = [
        _fan(unsafe, "#e0a3b0", "unsafe options"),
        _fan(safe, SAFE, "safe options"),
        *_crosses(resolved, unsafe),
        line3(_thin(chosen.ned_m), colour, 9.0, name=f"UAV {resolved.target}: {chosen.words}"),
    ]
    for uav, path in others.items():
        name = f"UAV {uav}" + (" (computes)" if uav == resolved.computing else "")
        traces.append(line3(_thin(path), colour_of(place[uav]), 5.0, name=name))
    paths = [c.ned_m for c in resolved.candidates] + list(others.values())
    traces.append(_starts(resolved, others, colour, place))
    low, high = _bounds(paths)
    note = (
        f"Sector {e.sector.replace('_', '-') or 'unknown'} (collision angle "
        f"{math.degrees(e.collision_angle_rad):.0f}°), violation in {e.time_to_violation_s:.1f} s; "
        f"found at stage '{e.stage}' among {e.safe_candidates} safe options, least separation "
        f"{e.least_separation:.2f} of required; predicted to last {e.manoeuvre_s:.0f} s, back on "
        f"plan after {e.intercept_s:.0f} s. Heights are drawn larger than distances."
    )
    label = f"{resolved.time_s:.1f} s: UAV {resolved.target}, {chosen.words}"
    return PickableContent(label, traces, {"scene": scene(low, high)}, note)


def _thin(path: Array) -> Array:
    """A path with every other sample, and its last."""
    return np.vstack([path[:-1:2], path[-1:]])


def _fan(candidates: Sequence[DrawnCandidate], colour: str, name: str) -> Json:
    """Several options as one line with gaps."""
    table = joined([_thin(c.ned_m) for c in candidates])
    table = table if table.shape[1] == 3 else np.empty((0, 3))
    return line3(table, colour, 2.5, name=name, hoverinfo="skip")


def _crosses(resolved: Resolved, unsafe: Sequence[DrawnCandidate]) -> list[Json]:
    hits = [c for c in unsafe if math.isfinite(c.overlap_s)]
    if not hits:
        return []
    at = np.array(
        [
            [np.interp(c.overlap_s, resolved.times_s, c.ned_m[:, axis]) for axis in range(3)]
            for c in hits
        ]
    )
    return [
        {
            "type": "scatter3d",
            "mode": "markers",
            "x": packed(at[:, 1]),
            "y": packed(at[:, 0]),
            "z": packed(-at[:, 2]),
            "marker": {"symbol": "diamond", "size": 3.5, "color": ALERT},
            "name": "first overlap",
            "hoverinfo": "skip",
        }
    ]


def _starts(
    resolved: Resolved, others: dict[int, Array], colour: str, place: dict[int, int]
) -> Json:
    paths = {resolved.target: resolved.chosen.ned_m, **others}
    at = np.array([path[0] for path in paths.values()])
    return {
        "type": "scatter3d",
        "mode": "markers+text",
        "x": packed(at[:, 1]),
        "y": packed(at[:, 0]),
        "z": packed(-at[:, 2]),
        "text": [str(uav) for uav in paths],
        "textposition": "top center",
        "marker": {
            "size": 5,
            "color": [colour, *(colour_of(place[uav]) for uav in others)],
            "line": {"color": "#22272e", "width": 1},
        },
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _bounds(paths: Sequence[Array]) -> tuple[Array, Array]:
    table = np.concatenate(paths)
    low, high = table.min(axis=0), table.max(axis=0)
    room = np.maximum(0.04 * (high - low), [50.0, 50.0, 15.0])
    return np.asarray(low - room), np.asarray(high + room)
