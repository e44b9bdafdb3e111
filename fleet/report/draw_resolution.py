"""Resolution trajectories: the candidates of each decision in space (figures 5, 8 and 9)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fleet.analysis.palette import colour_of
from fleet.model.conflict.risk import FAR
from fleet.model.types import Array
from fleet.report.curves import kept
from fleet.report.draw_airspace import PATH_M, scene
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
    """What each UAV could have been commanded, and was."""
    choices = [_choice(run_data, r) for r in resolved]
    first = choices[0] if choices else PickableContent("", [], {})
    return Chart(
        "resolution",
        "Resolution trajectories",
        "The candidates that the computing UAV logged, over 2 T<sub>s</sub> from the moment when "
        "the command starts: thin grey lines are safe, red ones are not (a diamond marks where "
        "they would first meet a zone); the thick line was chosen. Others are drawn as they then "
        "flew. Paths are predicted from the true states: with faults the computing UAV may have "
        "seen less.",
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
    place = {f.id: f.index for f in run_data.flights}
    colour = colour_of(place[resolved.target])
    others, chosen = resolved.near, resolved.chosen
    traces = [line3(_light(resolved, chosen.ned_m), colour, 9.0, name=_told(resolved))]
    if resolved.candidates:
        safe = [c for c in resolved.candidates if c.logged.safe]
        unsafe = [c for c in resolved.candidates if not c.logged.safe]
        traces = [
            _fan(resolved, unsafe, "#e0a3b0", "unsafe candidates"),
            _fan(resolved, safe, SAFE, "safe candidates"),
            *_crosses(resolved, unsafe),
            *traces,
        ]
    for uav, path in others.items():
        name = f"UAV {uav}" + (" (computes)" if uav == resolved.computing else "")
        traces.append(line3(_light(resolved, path), colour_of(place[uav]), 5.0, name=name))
    traces.append(_starts(resolved, others, colour, place))
    drawn = [chosen, *resolved.candidates]
    low, high = _bounds([c.ned_m for c in drawn] + list(others.values()))
    label = f"{resolved.time_s:.1f} s: UAV {resolved.target}, {chosen.words}"
    return PickableContent(label, traces, {"scene": scene(low, high)}, _why(resolved))


def _told(resolved: Resolved) -> str:
    return f"UAV {resolved.target}: {resolved.chosen.words}"


def _why(resolved: Resolved) -> str:
    """What the resolver says of its choice, as far as it says anything."""
    e = resolved.encounter
    safe = [c.safe for c in e.candidates]
    said = []
    if e.sector:
        sector = e.sector.replace("_", "-")
        said.append(f"sector {sector} (collision angle {math.degrees(e.collision_angle_rad):.0f}°)")
    if e.time_to_violation_s > 0.0:
        said.append(f"violation in {e.time_to_violation_s:.1f} s")
    if e.stage:
        said.append(f"found at stage '{e.stage}'")
    count = f"{len(safe)} candidates, {sum(safe)} of them safe"
    said.append(count if safe else "the resolver logged no candidates")
    if e.least_separation < FAR:
        said.append(f"least separation {e.least_separation:.2f} of required")
    if e.manoeuvre_s > 0.0:
        said.append(f"predicted to last {e.manoeuvre_s:.0f} s")
    if e.intercept_s > 0.0:
        said.append(f"back on plan after {e.intercept_s:.0f} s")
    text = ", ".join(said)
    drawn = "" if safe else " Only what it chose is drawn."
    return f"{text[0].upper()}{text[1:]}.{drawn} Heights are drawn larger than distances."


def _light(resolved: Resolved, path: Array) -> Array:
    """A path without the samples that a straight line is near enough to."""
    return path[kept(resolved.times_s, path, PATH_M)]


def _fan(resolved: Resolved, candidates: Sequence[DrawnCandidate], colour: str, name: str) -> Json:
    """Several candidates as one line with gaps."""
    table = joined([_light(resolved, c.ned_m) for c in candidates])
    table = table if table.shape[1] == 3 else np.empty((0, 3))
    return line3(table, colour, 2.5, name=name, hoverinfo="skip")


def _crosses(resolved: Resolved, unsafe: Sequence[DrawnCandidate]) -> list[Json]:
    hits = [(c.ned_m, c.logged.first_overlap_s) for c in unsafe if c.logged.first_overlap_s]
    if not hits:
        return []
    at = np.array(
        [
            [np.interp(overlap_s, resolved.times_s, path[:, axis]) for axis in range(3)]
            for path, overlap_s in hits
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
