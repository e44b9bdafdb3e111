"""Figures as data: what Plotly's JavaScript draws, written here as plain dictionaries.

Numbers go as packed 32-bit floats, half as much as text; a NaN is a gap. Nothing here imports
Plotly.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fleet.analysis.palette import colour_of, rgb_of
from fleet.model.types import Array

Json = dict[str, Any]

INK, GREY, PALE, GRID = "#22272e", "#6b7480", "#c3c9d1", "#e8ebef"
ALERT, WARN = "#b3123a", "#f7dfe4"
SAFE = "#7d8b99"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', Arial, sans-serif"
RIM = "#6f6a2c"
LIGHT = frozenset({"#F0E442"})
"""Colours that need a rim on white ground."""
DASHES = ("solid", "dash", "dot", "dashdot")
FEW_LINES = 8
"""Fleets of up to so many UAVs have a legend; larger ones are told apart by labels and hovering."""


@dataclass(frozen=True)
class PickableContent:
    """One of several contents of a chart: what the reader picks it by, and what it then shows."""

    label: str
    traces: list[Json]
    layout: Json = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Chart:
    """A figure of the page. `live` is what the script does with it as time goes on.

    live: "" (nothing), "cursor" (a line at the time, x is shared), "plan", "scene", "messages".
    """

    id: str
    title: str
    caption: str
    traces: list[Json]
    layout: Json
    height: int
    live: str = ""
    choices: list[PickableContent] = field(default_factory=list)
    pick: str = ""
    controls: str = ""
    """Further HTML beside the title, for the script."""


def packed(values: ArrayLike, dtype: str = "f4") -> Json:
    """Numbers as Plotly reads them: base64 of little-endian `f4`, `u1`, `i2`, `i4`."""
    table = np.ascontiguousarray(values, dtype=np.dtype(dtype).newbyteorder("<"))
    return {"dtype": dtype, "bdata": base64.b64encode(table.tobytes()).decode()}


def unpacked(column: Json) -> Array:
    """The numbers of `packed`."""
    table = np.frombuffer(base64.b64decode(column["bdata"]), dtype=column["dtype"])
    return table.astype(np.float64)


def faint(index: int, opacity: float) -> str:
    """A UAV's colour, let through."""
    red, green, blue = rgb_of(index)
    return f"rgba({red},{green},{blue},{opacity:g})"


def ink_on(index: int) -> str:
    """White or black, whichever is read better on a UAV's colour."""
    red, green, blue = rgb_of(index)
    return "#ffffff" if 0.3 * red + 0.6 * green + 0.1 * blue < 125.0 else INK


TOP, ROW = 32, 20
"""What the buttons above a chart take, and a row of its legend below them, in pixels."""


def dash_of(index: int) -> str:
    """Tells UAVs of the same colour apart."""
    return DASHES[index // 7 % len(DASHES)]


def figure_layout(height: int, *, legend_rows: int = 1, **more: Any) -> Json:
    """What all figures share; the legend stands in rows below the buttons, so that all is seen."""
    base: Json = {
        "font": {"family": FONT, "size": 13, "color": INK},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "#ffffff",
        "height": height,
        "margin": {"l": 66, "r": 18, "t": TOP + ROW * legend_rows, "b": 46},
        "hovermode": "closest",
        "hoverlabel": {"font": {"family": FONT, "size": 12}},
        "legend": {"orientation": "h", "x": 0, "y": 1.0, "xanchor": "left", "yanchor": "bottom"},
        "uirevision": "kept",
        "modebar": {"bgcolor": "rgba(255,255,255,0.85)", "color": GREY, "activecolor": INK},
    }
    return {**base, **more}


def axis(title: str = "", **more: Any) -> Json:
    """An axis with its title (with unit)."""
    base: Json = {
        "title": {"text": title, "standoff": 8, "font": {"size": 13}},
        "gridcolor": GRID,
        "zeroline": False,
        "linecolor": PALE,
        "showline": True,
        "ticks": "outside",
        "tickcolor": PALE,
        "ticklen": 4,
        "automargin": True,
    }
    return {**base, **more}


def time_axis(end_s: float, **more: Any) -> Json:
    """Simulated time in s, from the start of the run to its end."""
    return axis("Time (s)", range=[0.0, max(end_s, 1.0)], **more)


def line(
    x: ArrayLike, y: ArrayLike, colour: str, width: float = 2.0, dash: str = "solid", **more: Any
) -> Json:
    """A line in two dimensions."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": packed(x),
        "y": packed(y),
        "line": {"color": colour, "width": width, "dash": dash},
        **more,
    }


def line3(ned_m: Array, colour: str, width: float = 4.0, dash: str = "solid", **more: Any) -> Json:
    """A line in space: east, north, altitude from NED positions (n, 3)."""
    return {
        "type": "scatter3d",
        "mode": "lines",
        "x": packed(ned_m[:, 1]),
        "y": packed(ned_m[:, 0]),
        "z": packed(-ned_m[:, 2]),
        "line": {"color": colour, "width": width, "dash": dash},
        **more,
    }


def braid(x: Array, y: Array, indices: tuple[int, int], **more: Any) -> list[Json]:
    """A line of a pair: in the colour of one, dashed with that of the other."""
    one, two = (colour_of(n) for n in indices)
    first = line(x, y, one, 2.4, **more)
    more = {**more, "hoverinfo": "skip", "showlegend": False}
    more.pop("hovertemplate", None)
    return [first, line(x, y, two, 2.4, "9px,9px", **more)]


def cased(traces: Sequence[Json]) -> list[Json]:
    """The traces, with a dark rim under lines in a colour that is too light for white ground."""
    out: list[Json] = []
    for trace in traces:
        look = trace.get("line", {})
        if trace["type"] == "scatter" and look.get("color") in LIGHT:
            solid = look["dash"] == "solid"
            rim = {"color": RIM, "width": look["width"] + 1.4 if solid else 1.0, "dash": "solid"}
            under = {k: v for k, v in trace.items() if k not in ("hovertemplate", "name")}
            out.append({**under, "line": rim, "hoverinfo": "skip", "showlegend": False})
        out.append(trace)
    return out


def joined(curves: Sequence[Array]) -> Array:
    """Curves (n, k) one after the other, with a row of NaN after each."""
    parts = [np.vstack([c, np.full((1, c.shape[1]), np.nan)]) for c in curves]
    return np.vstack(parts) if parts else np.empty((0, 2))


def level_line(y: float, text: str, row: str = "", **more: Any) -> tuple[Json, Json]:
    """A horizontal line across a panel, and the words on it."""
    shape = {
        "type": "line",
        "xref": f"x{row} domain",
        "yref": f"y{row}",
        "x0": 0,
        "x1": 1,
        "y0": y,
        "y1": y,
        "line": {"color": ALERT, "width": 1.6, "dash": "dash"},
        **more,
    }
    words = {
        "xref": f"x{row} domain",
        "yref": f"y{row}",
        "x": 0.995,
        "y": y,
        "xanchor": "right",
        "yanchor": "bottom",
        "showarrow": False,
        "text": text,
        "font": {"color": ALERT, "size": 12},
    }
    return shape, words


def below(y: float, row: str = "") -> Json:
    """The forbidden part of a panel, tinted."""
    return {
        "type": "rect",
        "xref": f"x{row} domain",
        "yref": f"y{row}",
        "x0": 0,
        "x1": 1,
        "y0": 0,
        "y1": y,
        "fillcolor": WARN,
        "opacity": 0.6,
        "line": {"width": 0},
        "layer": "below",
    }
