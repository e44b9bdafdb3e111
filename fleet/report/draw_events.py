"""The timeline, and the message diagram's frame (the script fills it in as time goes on)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

from fleet.analysis.palette import colour_of
from fleet.protocol.classes import DELIVERY_ORDER
from fleet.report.events import Bar, EventMark, EventTimeline, name_of
from fleet.report.links import message_columns
from fleet.report.page_parts import options_html
from fleet.report.plot import (
    ALERT,
    GREY,
    INK,
    Chart,
    Json,
    axis,
    figure_layout,
    ink_on,
    packed,
    time_axis,
)
from fleet.report.run_data import RunData

ROW_PX = 30
MOST_MESSAGES = 120_000
WINDOWS_S = (0.3, 0.5, 1.0, 2.0, 5.0, 10.0)
"""How much before and after a moment the message diagram may show."""
COLOURS = {"risk": "#8a94a0", "fault": "#d3d8de", "absent": INK}
MARKS: dict[str, Json] = {
    "command": {"symbol": "triangle-right", "color": INK, "size": 9},
    "repeated": {"symbol": "triangle-right-open", "color": INK, "size": 7},
    "accepted": {
        "symbol": "circle",
        "color": "#ffffff",
        "size": 8,
        "line": {"color": INK, "width": 1.5},
    },
    "duplicate": {"symbol": "circle-open", "color": GREY, "size": 6},
    "refused": {"symbol": "x", "color": ALERT, "size": 9},
    "unresolved": {"symbol": "diamond", "color": ALERT, "size": 10},
}
RAISED = {"command": -0.26, "repeated": -0.26, "accepted": 0.26, "duplicate": 0.26, "refused": 0.26}
"""Commands are above the middle of a row, answers below."""
NAMES = {
    "risk": "pair at risk",
    "mandate": "computes",
    "command": "command flown",
    "fault": "fault",
    "absent": "process held or down",
}
CLASS_COLOURS = dict(
    zip(
        DELIVERY_ORDER,
        cycle(("#b4bcc6", "#56B4E9", "#009E73", "#D55E00", "#0072B2", "#E69F00", "#CC79A7")),
        strict=False,
    )
)
"""Of messages in the diagram and the statistics, by class."""


def timeline_chart(run_data: RunData, timeline: EventTimeline) -> Chart:
    """Everything that lasted and everything that happened, row by row."""
    rows = timeline.rows
    place = {f.id: f.index for f in run_data.flights}
    traces = [
        _bars([b for b in timeline.bars if b.kind == kind], name, rows, place)
        for kind, name in NAMES.items()
    ]
    traces += [
        _marks([m for m in timeline.moments if m.kind == kind], kind, rows) for kind in MARKS
    ]
    height = 110 + ROW_PX * max(len(rows), 3)
    more = f" {timeline.left_out} more pairs at risk are left out." if timeline.left_out else ""
    return Chart(
        "timeline",
        "Timeline",
        "Pairs at risk, who computes for whom, commands and answers at the UAV that they are for, "
        f"faults. Hover for details; click to go to that time.{more}",
        [t for t in traces if t["x"]],
        figure_layout(
            height,
            xaxis=time_axis(run_data.end_s),
            yaxis=axis(
                range=[len(rows) - 0.4, -0.6],
                showgrid=True,
                tickfont={"size": 12},
                ticks="",
                tickvals=list(range(len(rows))),
                ticktext=[r if len(r) < 34 else f"{r[:32]}\N{HORIZONTAL ELLIPSIS}" for r in rows],
            ),
            barmode="overlay",
            uniformtext={"mode": "hide", "minsize": 10},
        ),
        height,
        "cursor",
    )


def _bars(bars: Sequence[Bar], name: str, rows: Sequence[str], place: dict[int, int]) -> Json:
    colours = [COLOURS[b.kind] if b.uav is None else colour_of(place[b.uav]) for b in bars]
    return {
        "type": "bar",
        "orientation": "h",
        "name": name,
        "y": [rows.index(b.row) for b in bars],
        "width": 0.62,
        "text": [b.note for b in bars],
        "textposition": "inside",
        "insidetextanchor": "start",
        "insidetextfont": {
            "size": 11,
            "color": [INK if b.uav is None else ink_on(place[b.uav]) for b in bars],
        },
        "base": [b.start_s for b in bars],
        "x": [b.end_s - b.start_s for b in bars],
        "marker": {
            "color": colours,
            "line": {"color": "#ffffff", "width": 1},
            "pattern": {
                "shape": ["/" if b.kind == "fault" else "" for b in bars],
                "fillmode": "overlay",
                "fgcolor": GREY,
                "size": 6,
                "solidity": 0.25,
            },
        },
        "customdata": [[b.text, b.start_s, b.end_s] for b in bars],
        "hovertemplate": "%{customdata[0]}<br>%{customdata[1]:.1f} to %{customdata[2]:.1f} s"
        "<extra></extra>",
        "showlegend": False,
    }


def _marks(moments: Sequence[EventMark], kind: str, rows: Sequence[str]) -> Json:
    return {
        "type": "scatter",
        "mode": "markers",
        "name": {"command": "command issued", "repeated": "issued again"}.get(kind, kind),
        "x": [m.time_s for m in moments],
        "y": [rows.index(m.row) + RAISED.get(kind, 0.0) for m in moments],
        "text": [m.text for m in moments],
        "marker": MARKS[kind],
        "hovertemplate": "%{text}<br>%{x:.2f} s<extra></extra>",
    }


def messages_chart(run_data: RunData) -> Chart:
    """The frame of the message diagram."""
    names = [name_of(p) for p in run_data.processes]
    height = 120 + max(26 if len(names) <= 12 else 17, 0) * max(len(names), 4)
    windows = options_html([f"{n:g}" for n in WINDOWS_S], [f"{n:g} s" for n in WINDOWS_S], 2)
    return Chart(
        "messages",
        "Messages between processes",
        "Each line is one message on its way, from its sender when it was sent to its receiver "
        "when it was delivered. A red cross on a stump is a message that was lost; what was meant "
        "for a process that was down (grey) is not drawn. The slider sets the moment; click a "
        "class in the legend to hide or show it.",
        [],
        figure_layout(
            height,
            xaxis=axis("Time (s)"),
            yaxis=axis(
                tickvals=list(range(len(names))),
                ticktext=names,
                range=[len(names) - 0.5, -0.5],
                tickfont={"size": 12 if len(names) <= 12 else 10},
                ticks="",
            ),
        ),
        height,
        "messages",
        controls=f"<label>before and after <select id='messages-window'>{windows}</select></label>",
    )


def messages_data(run_data: RunData) -> Json:
    """What the script draws the message diagram from."""
    columns, left_out = message_columns(run_data, MOST_MESSAGES)
    kinds = {"src": "i2", "dst": "i2", "kind": "u1", "fate": "u1", "sent_s": "f4", "got_s": "f4"}
    return {
        "processes": [name_of(p) for p in run_data.processes],
        "kinds": [
            {"kind": k, "colour": CLASS_COLOURS[k]} for k in run_data.link_messages.kind_names
        ],
        "fates": list(run_data.link_messages.fate_names),
        "left_out": left_out,
        "absent": [
            [run_data.processes.index(process), start, end]
            for (process, _), spans in run_data.absences.items()
            for start, end in spans
        ],
        **{name: packed(columns[name], dtype) for name, dtype in kinds.items()},
    }
