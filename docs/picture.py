"""Draw a log of two or more UAVs as SVG: plan view, altitude and separation.

Usage: python docs/picture.py LOG SVG
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.common_times import positions_of
from fleet.analysis.separation import Nearness, PairCurve, nearness_of, pair_curve
from fleet.analysis.words import separation_text
from fleet.log.reader import Summary, read
from fleet.log.run_metadata import run_metadata_of
from fleet.model.conflict.tracks import AVOIDING
from fleet.protocol import codec
from fleet.protocol.messages import Election, Truth

Array = NDArray[np.float64]
Points = Iterable[tuple[float, float]]

WIDTH, HEIGHT = 1100, 550
LANE = 2.5
"""How far a track is drawn to its right, in pixels: opposite ones can be told apart."""
WIDE = 'stroke-opacity="0.5" stroke-linecap="round"'

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
"""Okabe and Ito's, told apart by colour-blind readers too; UAVs beyond the eighth begin again."""
INK, GREY, GRID, ALERT, PAIR = "#222222", "#666666", "#e6e6e6", "#b00020", "#9a9a9a"
STYLE = """
text { font-family: 'DejaVu Sans', Verdana, Helvetica, Arial, sans-serif; font-size: 12px; }
.title { font-size: 14px; font-weight: bold; }
.head { font-size: 18px; font-weight: bold; }
.label { font-weight: bold; }
"""


@dataclass(frozen=True)
class Flight:
    """What one UAV did: times (s), NED positions (m), and whether it flew a manoeuvre."""

    uav: int
    times_s: Array
    ned_m: Array
    escaping: NDArray[np.bool_]

    @property
    def colour(self) -> str:
        """The same in all plots."""
        return COLOURS[(self.uav - 1) % len(COLOURS)]

    def spans(self) -> list[tuple[int, int]]:
        """First and last sample of each manoeuvre."""
        edges = np.diff(np.concatenate([[0], self.escaping.astype(np.int8), [0]]))
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        last = len(self.times_s) - 1
        return [(int(a), min(int(b), last)) for a, b in zip(starts, ends, strict=True)]


@dataclass(frozen=True)
class Story:
    """A run as it is drawn; `elected` is the first computing UAV (0: nobody)."""

    name: str
    flights: list[Flight]
    elected: int
    elected_s: float
    zone_m: float
    near: Nearness
    pairs: list[PairCurve]


def story_of(log: Path) -> Story:
    """Read a log."""
    summary = Summary(log)
    truths: dict[int, list[Truth]] = {}
    elected, elected_s = 0, 0.0
    for record in read(log, summary):
        kind = codec.kind_of(record.topic)
        if kind not in ("truth", "election"):
            continue
        message = codec.decode(record.topic, record.payload)
        if isinstance(message, Truth):
            truths.setdefault(message.id, []).append(message)
        elif isinstance(message, Election) and not elected:
            elected, elected_s = message.computing, message.t_ns / 1e9
    scenario = run_metadata_of(log, summary.metadata).scenario
    ids, required = sorted(truths), scenario.required()
    flown = {uav: {t.t_ns: t.position_ned_m for t in own} for uav, own in truths.items()}
    times_ns, positions = positions_of(ids, flown)
    near = nearness_of(ids, times_ns, positions, required)
    place = dict(zip(ids, positions, strict=True))
    return Story(
        scenario.name,
        [_flight(uav, truths[uav]) for uav in ids],
        elected,
        elected_s,
        scenario.zone.radius_m,
        near,
        [pair_curve(m, times_ns, place[m.a] - place[m.b], required) for m in near.minima],
    )


def _flight(uav: int, truths: Sequence[Truth]) -> Flight:
    return Flight(
        uav,
        np.array([t.t_ns for t in truths]) / 1e9,
        np.array([t.position_ned_m for t in truths]),
        np.array([t.mode in AVOIDING for t in truths]),
    )


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


def draw_arrow(page: Page, frame: Frame, flight: Flight, index: int) -> None:
    """An arrow head at a sample of the plan view, along the track."""
    before, after = flight.ned_m[index - 5] / 1e3, flight.ned_m[index] / 1e3
    tail = np.array(frame.at(before[1], before[0]))
    head = np.array(frame.at(after[1], after[0]))
    along = (head - tail) / np.hypot(*(head - tail))
    across = np.array([-along[1], along[0]])
    head = head + LANE * across
    tip, base = head + 6 * along, head - 5 * along
    corners = (tip, base + 5 * across, base - 5 * across)
    page.shape([(float(x), float(y)) for x, y in corners], flight.colour)


def draw_start(page: Page, frame: Frame, flight: Flight, zone_m: float) -> None:
    """Where a UAV starts, its protected zone and its name, behind it."""
    start = np.array(frame.at(flight.ned_m[0, 1] / 1e3, flight.ned_m[0, 0] / 1e3))
    scale = frame.box[2] / (frame.x[1] - frame.x[0])
    place = (float(start[0]), float(start[1]))
    page.ring(place, scale * zone_m / 1e3, flight.colour)
    page.dot(place, 5, flight.colour)
    moved = flight.ned_m[5] - flight.ned_m[0]
    ahead = np.array([moved[1], -moved[0]]) / np.hypot(moved[0], moved[1])
    x, y = start - (scale * zone_m / 1e3 + 8) * ahead
    anchor = "end" if ahead[0] > 0.5 else "start" if ahead[0] < -0.5 else "middle"
    name = (float(x), float(y) + 4.0 - 5.0 * float(ahead[1]))
    page.text(name, f"UAV {flight.uav}", anchor=anchor, colour=flight.colour, kind="label")


def draw_plan(page: Page, run_data: Story, until_s: float) -> None:
    """The trajectories from above."""
    shown = [f.ned_m[f.times_s <= until_s] / 1e3 for f in run_data.flights]
    reach = rounded(0.0, 1.3 * max(float(np.abs(km[:, :2]).max()) for km in shown), 6)[1]
    frame = Frame((66.0, 64.0, 420.0, 420.0), (-reach, reach), (-reach, reach))
    draw_axes(page, frame, "Plan view", ("east (km)", "north (km)"), (6, 6))
    for f, km in zip(run_data.flights, shown, strict=True):
        for a, b in f.spans():
            part = km[a : b + 1]
            page.path(frame.line(part[:, 1], part[:, 0], LANE), f.colour, 6, WIDE)
    for f, km in zip(run_data.flights, shown, strict=True):
        page.path(frame.line(km[:, 1], km[:, 0], LANE), f.colour, 1.8)
    for f, km in zip(run_data.flights, shown, strict=True):
        draw_start(page, frame, f, run_data.zone_m)
        for index in (len(km) // 10, len(km) - 1):
            draw_arrow(page, frame, f, max(index, 5))
    page.text((478, 476), "each track is drawn a little to its right", anchor="end", colour=GREY)


def time_range(run_data: Story) -> tuple[float, float]:
    """From the start until all has calmed down: the manoeuvres are over and nobody is near."""
    times = run_data.flights[0].times_s
    ends = [f.times_s[b] for f in run_data.flights for _, b in f.spans()]
    near = [float(p.times_s[p.normalised < 3.0].max(initial=0.0)) for p in run_data.pairs]
    until = max([*ends, *near], default=times[-1])
    return 0.0, float(min(times[-1], np.ceil((until + 15.0) / 20.0) * 20.0))


def draw_altitude(page: Page, run_data: Story, times: tuple[float, float]) -> None:
    """Altitude against time; where several UAVs are level with each other, dashes in turn."""
    clock = run_data.flights[0].times_s
    clock = clock[clock <= times[1]]
    up = np.array([-f.ned_m[: len(clock), 2] for f in run_data.flights])
    low, high = float(up.min()), float(up.max())
    spread = max(high - low, 20.0)
    limits = rounded(low - 0.1 * spread, high + 0.1 * spread, 5)
    frame = Frame((584.0, 64.0, 488.0, 168.0), times, limits)
    draw_axes(page, frame, "Altitude", ("", "altitude (m)"), (8, 5))
    draw_election(page, frame, run_data, named=True)
    for f, own in zip(run_data.flights, up, strict=True):
        for a, b in f.spans():
            page.path(frame.line(clock[a : b + 1], own[a : b + 1]), f.colour, 6, WIDE)
    for n, f in enumerate(run_data.flights):
        level = np.abs(up - up[n]) < 0.01 * spread
        changes = np.flatnonzero((level[:, 1:] != level[:, :-1]).any(axis=0)) + 1
        for a, b in pairwise([0, *changes.tolist(), len(clock)]):
            mates = np.flatnonzero(level[:, a])
            dash, turn = 7 * (len(mates) > 1), int(np.flatnonzero(mates == n)[0])
            extra = f'stroke-dasharray="{dash} {dash * (len(mates) - 1)}" '
            extra += f'stroke-dashoffset="{-dash * turn}"'
            points = frame.line(clock[a : b + 1], up[n, a : b + 1])
            page.path(points, f.colour, 1.8, extra if dash else "")


def draw_election(page: Page, frame: Frame, run_data: Story, *, named: bool) -> None:
    """A line at the first election."""
    if not run_data.elected:
        return
    (x, top), (_, bottom) = frame.at(run_data.elected_s, frame.y[1]), frame.at(0.0, frame.y[0])
    page.path([(x, top), (x, bottom)], GREY, 1.2, 'stroke-dasharray="2 3"')
    if named:
        words = f"{run_data.elected_s:g} s: UAV {run_data.elected} is elected and commands"
        page.text((x + 6, top + 16), words, colour=GREY)


def draw_separation(page: Page, run_data: Story, times: tuple[float, float]) -> None:
    """Normalised separation of each pair, and the least of all."""
    top = 5.0
    frame = Frame((584.0, 294.0, 488.0, 190.0), times, (0.0, top))
    left, _, width, _ = frame.box
    _, limit = frame.at(0.0, 1.0)
    bottom = frame.box[1] + frame.box[3]
    page.rectangle((left, limit, width, bottom - limit), ALERT, 'fill-opacity="0.07"')
    title = "Normalised separation of each pair"
    draw_axes(page, frame, title, ("time (s)", "separation / required"), (8, 5))
    draw_election(page, frame, run_data, named=False)
    for pair in run_data.pairs:
        for run in _runs((pair.normalised <= top) & (pair.times_s <= times[1])):
            page.path(frame.line(pair.times_s[run], pair.normalised[run]), PAIR, 1.2)
    clock, least = run_data.near.times_ns / 1e9, run_data.near.least
    for run in _runs((least <= top) & (clock <= times[1])):
        page.path(frame.line(clock[run], least[run]), INK, 2.4)
    page.path([(left, limit), (left + width, limit)], ALERT, 1.6, 'stroke-dasharray="7 4"')
    page.text((left + 8, limit + 16), "loss of separation", colour=ALERT)
    page.text((left + width - 8, limit + 16), "required: 1", colour=ALERT, anchor="end")
    nearest = run_data.near.minima[0]
    place = frame.at(nearest.t_s, nearest.least_separation)
    page.dot(place, 5, INK)
    told = separation_text(nearest.least_separation)
    words = f"least: {told} (UAV {nearest.a} and {nearest.b}, {nearest.t_s:.1f} s)"
    page.text((place[0], bottom - 10), words, anchor="middle", kind="label")


def _runs(mask: NDArray[np.bool_]) -> list[slice]:
    """The stretches in which a mask holds."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def draw_legend(page: Page) -> None:
    """What the strokes mean."""
    y = HEIGHT - 9.0
    page.ring((73, y - 4), 8, GREY)
    page.dot((73, y - 4), 3.5, GREY)
    page.text((87, y), "start, protected zone")
    page.path([(240, y - 4), (266, y - 4)], GREY, 1.8)
    page.text((273, y), "flight plan")
    page.path([(362, y - 4), (386, y - 4)], GREY, 6, WIDE)
    page.text((395, y), "manoeuvre")
    page.path([(584, y - 4), (610, y - 4)], INK, 2.4)
    page.text((617, y), "least of all pairs")
    page.path([(750, y - 4), (776, y - 4)], PAIR, 1.2)
    page.text((783, y), "each pair")


def picture(run_data: Story) -> str:
    """The SVG of a run."""
    page = Page()
    page.text((66, 28), f"{run_data.name}: {len(run_data.flights)} UAVs", kind="head")
    times = time_range(run_data)
    draw_plan(page, run_data, times[1])
    draw_altitude(page, run_data, times)
    draw_separation(page, run_data, times)
    draw_legend(page)
    return page.svg()


def main(arguments: Sequence[str]) -> None:
    """Draw the log named first into the file named second."""
    if len(arguments) != 2:
        sys.exit("usage: python docs/picture.py LOG SVG")
    Path(arguments[1]).write_text(picture(story_of(Path(arguments[0]))), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
