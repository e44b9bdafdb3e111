"""Link statistics: what share of messages came, by link and against time, and how late."""

from __future__ import annotations

import numpy as np

from fleet.protocol.messages import StateBroadcast
from fleet.report.draw_events import CLASS_COLOURS
from fleet.report.events import name_of
from fleet.report.links import latencies, share_by_link, share_over_time
from fleet.report.plot import GREY, Chart, axis, figure_layout, line, packed, time_axis
from fleet.report.run_data import RunData

BIN_S = 5.0
SCALE = [[0.0, "#7a0f2b"], [0.5, "#e39a6a"], [0.9, "#dfe7ee"], [1.0, "#4f86b8"]]
"""Dark where little comes: also in print, and without telling red from green."""


def matrix_chart(run_data: RunData) -> Chart:
    """Who hears whom."""
    share, total = share_by_link(run_data)
    names = [
        name_of(p).replace("coordinator", "coord.").replace("UAV ", "") for p in run_data.processes
    ]
    count = len(names)
    heat = {
        "type": "heatmap",
        "z": {**packed(100.0 * share), "shape": f"{count}, {count}"},
        "x": names,
        "y": names,
        "zmin": 0,
        "zmax": 100,
        "colorscale": SCALE,
        "xgap": 1,
        "ygap": 1,
        "customdata": {**packed(total, "i4"), "shape": f"{count}, {count}"},
        "hovertemplate": "%{y} to %{x}: %{z:.1f} % of %{customdata} came<extra></extra>",
        "colorbar": {
            "title": {"text": "delivered (%)", "side": "right", "font": {"size": 12}},
            "thickness": 12,
        },
    }
    if count <= 8:
        heat["text"] = [[_percent(v) for v in row] for row in 100.0 * share]
        heat["texttemplate"] = "%{text}"
    height = min(470, 170 + 34 * max(count, 5))
    return Chart(
        "matrix",
        "Delivered, by link",
        "From the process on the left to the one below.",
        [heat],
        figure_layout(
            height,
            xaxis=axis("to", type="category", showline=False, ticks="", showgrid=False),
            yaxis=axis(
                "from",
                type="category",
                autorange="reversed",
                showline=False,
                ticks="",
                showgrid=False,
            ),
            plot_bgcolor="#f3f5f7",
        ),
        height,
    )


def _percent(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.0f}"


def share_chart(run_data: RunData) -> Chart:
    """The share that came, against the time of sending."""
    middle, shares = share_over_time(run_data, BIN_S)
    traces = [
        line(
            middle,
            100.0 * share,
            CLASS_COLOURS[kind] if kind != StateBroadcast.kind else GREY,
            2.0,
            name=kind,
            connectgaps=False,
            mode="lines+markers",
            marker={"size": 4},
            hovertemplate=f"{kind}: %{{y:.0f}} % of those sent about %{{x:.0f}} s<extra></extra>",
        )
        for kind, share in reversed(list(shares.items()))
    ]
    return Chart(
        "share",
        "Delivered, against time",
        f"Share of messages that came, by the time of sending, in steps of {BIN_S:g} s.",
        traces,
        figure_layout(
            370,
            xaxis=time_axis(run_data.end_s),
            yaxis=axis("Delivered (%)", range=[-3.0, 105.0]),
            legend_rows=2,
        ),
        370,
        "cursor",
    )


def latency_chart(run_data: RunData) -> Chart:
    """How many messages came within which time."""
    traces = []
    found = latencies(run_data)
    most_ms = 1e3 * max((values[-1] for values, _ in found.values()), default=1.0)
    for kind, (values, share) in reversed(list(found.items())):
        x = np.concatenate([[0.0], values, [values[-1]]])
        y = np.concatenate([[0.0], share, [1.0]])
        hover = f"{kind}: %{{y:.1f}} % came within %{{x:.3g}} ms<extra></extra>"
        colour = CLASS_COLOURS[kind] if kind != StateBroadcast.kind else GREY
        curve = line(1e3 * x, 100.0 * y, colour, 2.0, name=kind, hovertemplate=hover)
        curve["line"]["shape"] = "hv"
        traces.append(curve)
    return Chart(
        "latency",
        "Latency",
        "Share of those delivered that came within a time. In lockstep the least is one tick.",
        traces,
        figure_layout(
            370,
            xaxis=axis("Latency (ms)", range=[0.0, 1.15 * most_ms]),
            yaxis=axis("Came (%)", range=[-3.0, 105.0]),
            legend_rows=2,
        ),
        370,
    )
