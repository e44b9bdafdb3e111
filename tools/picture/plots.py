"""The three plots: plan view, altitude and separation."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.words import separation_text
from tools.picture.run import Flight, PicturedRun
from tools.picture.svg import GREY, HEIGHT, INK, Frame, Page, draw_axes, rounded

LANE = 2.5
"""How far a track is drawn to its right, in pixels: opposite ones can be told apart."""
WIDE = 'stroke-opacity="0.5" stroke-linecap="round"'
ALERT, PAIR = "#b00020", "#9a9a9a"


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


def draw_start(page: Page, frame: Frame, flight: Flight) -> None:
    """Where a UAV starts, its protected zone and its name, behind it."""
    start = np.array(frame.at(flight.ned_m[0, 1] / 1e3, flight.ned_m[0, 0] / 1e3))
    scale = frame.box[2] / (frame.x[1] - frame.x[0])
    place = (float(start[0]), float(start[1]))
    page.ring(place, scale * flight.zone_m / 1e3, flight.colour)
    page.dot(place, 5, flight.colour)
    moved = flight.ned_m[5] - flight.ned_m[0]
    ahead = np.array([moved[1], -moved[0]]) / np.hypot(moved[0], moved[1])
    x, y = start - (scale * flight.zone_m / 1e3 + 8) * ahead
    anchor = "end" if ahead[0] > 0.5 else "start" if ahead[0] < -0.5 else "middle"
    name = (float(x), float(y) + 4.0 - 5.0 * float(ahead[1]))
    page.text(name, f"UAV {flight.uav}", anchor=anchor, colour=flight.colour, kind="label")


def draw_plan(page: Page, run_data: PicturedRun, until_s: float) -> None:
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
        draw_start(page, frame, f)
        for index in (len(km) // 10, len(km) - 1):
            draw_arrow(page, frame, f, max(index, 5))
    page.text((478, 476), "each track is drawn a little to its right", anchor="end", colour=GREY)


def time_range(run_data: PicturedRun) -> tuple[float, float]:
    """From the start until all has calmed down: the manoeuvres are over and nobody is near."""
    times = run_data.flights[0].times_s
    ends = [f.times_s[b] for f in run_data.flights for _, b in f.spans()]
    near = [float(p.times_s[p.normalised < 3.0].max(initial=0.0)) for p in run_data.pairs]
    until = max([*ends, *near], default=times[-1])
    return 0.0, float(min(times[-1], np.ceil((until + 15.0) / 20.0) * 20.0))


def draw_altitude(page: Page, run_data: PicturedRun, times: tuple[float, float]) -> None:
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


def draw_election(page: Page, frame: Frame, run_data: PicturedRun, *, named: bool) -> None:
    """A line at the first election."""
    if not run_data.elected:
        return
    (x, top), (_, bottom) = frame.at(run_data.elected_s, frame.y[1]), frame.at(0.0, frame.y[0])
    page.path([(x, top), (x, bottom)], GREY, 1.2, 'stroke-dasharray="2 3"')
    if named:
        words = f"{run_data.elected_s:g} s: UAV {run_data.elected} is elected and commands"
        page.text((x + 6, top + 16), words, colour=GREY)


def draw_separation(page: Page, run_data: PicturedRun, times: tuple[float, float]) -> None:
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


def picture(run_data: PicturedRun) -> str:
    """The SVG of a run."""
    page = Page()
    page.text((66, 28), f"{run_data.name}: {len(run_data.flights)} UAVs", kind="head")
    times = time_range(run_data)
    draw_plan(page, run_data, times[1])
    draw_altitude(page, run_data, times)
    draw_separation(page, run_data, times)
    draw_legend(page)
    return page.svg()
