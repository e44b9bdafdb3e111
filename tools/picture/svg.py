"""SVG: a page to draw on, and plots with axes on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np

from fleet.model.types import Array

Points = Iterable[tuple[float, float]]

WIDTH, HEIGHT = 1100, 550
INK, GREY, GRID = "#222222", "#666666", "#e6e6e6"
STYLE = """
text { font-family: 'DejaVu Sans', Verdana, Helvetica, Arial, sans-serif; font-size: 12px; }
.title { font-size: 14px; font-weight: bold; }
.head { font-size: 18px; font-weight: bold; }
.label { font-weight: bold; }
"""


@dataclass(frozen=True)
class Frame:
    """A plot's place on the page (left, top, width, height) and the ranges of its axes."""

    box: tuple[float, float, float, float]
    x: tuple[float, float]
    y: tuple[float, float]

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a point lands on the page."""
        left, top, width, height = self.box
        return (
            left + width * (x - self.x[0]) / (self.x[1] - self.x[0]),
            top + height * (self.y[1] - y) / (self.y[1] - self.y[0]),
        )

    def line(self, xs: Array, ys: Array, shift: float = 0.0) -> list[tuple[float, float]]:
        """A curve on the page, moved to its right by `shift`, without points that do not show."""
        points = np.array([self.at(float(x), float(y)) for x, y in zip(xs, ys, strict=True)])
        if shift and len(points) > 1:
            along = np.gradient(points, axis=0)
            along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
            points = points + shift * np.column_stack([-along[:, 1], along[:, 0]])
        return [(float(x), float(y)) for x, y in simplified(points)]


def simplified(points: Array) -> Array:
    """A curve without the points that lie within 0.1 pixels of it (Douglas and Peucker)."""
    keep = np.zeros(len(points), dtype=np.bool_)
    keep[[0, -1]] = True
    open_spans = [(0, len(points) - 1)]
    while open_spans:
        a, b = open_spans.pop()
        if b - a < 2:
            continue
        chord, inner = points[b] - points[a], points[a + 1 : b] - points[a]
        length = max(float(np.hypot(*chord)), 1e-9)
        off = np.abs(chord[0] * inner[:, 1] - chord[1] * inner[:, 0]) / length
        worst = int(np.argmax(off))
        if off[worst] > 0.1:
            middle = a + 1 + worst
            keep[middle] = True
            open_spans += [(a, middle), (middle, b)]
    return points[keep]


class Page:
    """SVG elements, in order of drawing."""

    def __init__(self) -> None:
        self._parts: list[str] = []

    def path(self, points: Points, colour: str, width: float, extra: str = "") -> None:
        """A polyline."""
        d = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._parts.append(
            f'<polyline points="{d}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
            f'stroke-linejoin="round" {extra}/>'
        )

    def shape(self, points: Points, colour: str) -> None:
        """A filled polygon with a white rim."""
        d = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._parts.append(f'<polygon points="{d}" fill="{colour}" stroke="#fff"/>')

    def dot(self, place: tuple[float, float], radius: float, colour: str) -> None:
        """A filled circle with a white rim."""
        self._parts.append(
            f'<circle cx="{place[0]:.1f}" cy="{place[1]:.1f}" r="{radius:g}" fill="{colour}" '
            'stroke="#fff" stroke-width="1.5"/>'
        )

    def ring(self, place: tuple[float, float], radius: float, colour: str) -> None:
        """A faint disc."""
        self._parts.append(
            f'<circle cx="{place[0]:.1f}" cy="{place[1]:.1f}" r="{radius:.1f}" fill="{colour}" '
            f'fill-opacity="0.13" stroke="{colour}" stroke-opacity="0.6" />'
        )

    def rectangle(self, box: tuple[float, float, float, float], fill: str, extra: str = "") -> None:
        """A rectangle."""
        left, top, width, height = box
        self._parts.append(
            f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}" '
            f'fill="{fill}" {extra}/>'
        )

    def text(
        self,
        place: tuple[float, float],
        text: str,
        *,
        anchor: str = "start",
        colour: str = INK,
        kind: str = "",
        turned: bool = False,
    ) -> None:
        """Text with a white halo, so that lines under it do not disturb it."""
        x, y = place
        turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
        self._parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}" '
            f'class="{kind}" stroke="#fff" stroke-width="3" paint-order="stroke"{turn}>'
            f"{escape(text)}</text>"
        )

    def svg(self) -> str:
        """The whole document."""
        body = "\n".join(self._parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
            f'viewBox="0 0 {WIDTH} {HEIGHT}" role="img">\n<style>{STYLE}</style>\n'
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>\n{body}\n</svg>\n'
        )


def nice_step(span: float, wanted: int) -> float:
    """A step of 1, 2 or 5 times a power of ten that makes about so many intervals."""
    raw = span / wanted
    power = 10.0 ** np.floor(np.log10(raw))
    return float(power * min((1, 2, 5, 10), key=lambda m: abs(m * power - raw)))


def rounded(low: float, high: float, wanted: int) -> tuple[float, float]:
    """A range widened to whole steps."""
    step = nice_step(high - low, wanted)
    return float(np.floor(low / step) * step), float(np.ceil(high / step) * step)


def draw_axes(
    page: Page, frame: Frame, title: str, labels: tuple[str, str], ticks: tuple[int, int]
) -> None:
    """Grid, numbers, title and axis labels."""
    left, top, width, height = frame.box
    for low, high, wanted, along_x in ((*frame.x, ticks[0], True), (*frame.y, ticks[1], False)):
        step = nice_step(high - low, wanted)
        for value in np.arange(np.ceil(low / step - 1e-9) * step, high + step * 1e-6, step):
            shown = f"{value + 0.0:g}".replace("-", "\N{MINUS SIGN}")
            if along_x:
                x, _ = frame.at(float(value), low)
                page.path([(x, top), (x, top + height)], GRID, 1)
                page.text((x, top + height + 17), shown, anchor="middle", colour=GREY)
            else:
                _, y = frame.at(0.0, float(value))
                page.path([(left, y), (left + width, y)], GRID, 1)
                page.text((left - 7, y + 4), shown, anchor="end", colour=GREY)
    page.rectangle(frame.box, "none", f'stroke="{GREY}"')
    page.text((left, top - 10), title, kind="title")
    page.text((left + width / 2, top + height + 34), labels[0], anchor="middle")
    page.text((left - 42, top + height / 2), labels[1], anchor="middle", turned=True)
