"""Who is for certain not at risk: pairs of corridors that stay apart, in closed form.

A few UAVs take less time so than by samples, and most of the time nobody is at risk. What is not
certain is left to the samples.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required
from fleet.model.conflict.tracks import StateReport
from fleet.model.units import to_s
from fleet.model.vehicle.corridors import Corridor

ROUNDING_M = 1.0
"""By so much more than required corridors must be apart: much more than rounding can be."""

Place = tuple[int, int]
"""A pair, as places of reports."""


def in_doubt(
    reports: Sequence[StateReport], pairs: Collection[Place], now_ns: int, outlook: Outlook
) -> list[Place]:
    """Those of some pairs, told as places of reports, that may be at risk within the horizon.

    Samples are taken to be joined by chords.
    """
    ways: dict[int, Sequence[Corridor]] = {}
    for place in {place for pair in pairs for place in pair}:
        ways[place] = _ways(reports[place], now_ns, outlook)
    return [
        (i, j)
        for i, j in pairs
        if not _apart(
            ways[i], ways[j], outlook, outlook.required_of((reports[i].id, reports[j].id))
        )
    ]


def _ways(report: StateReport, now_ns: int, outlook: Outlook) -> Sequence[Corridor]:
    """The corridors of what a UAV flies, and of what it would fly if released; none: not known."""
    model, age_s = outlook.models.of(report.id), max(0.0, to_s(now_ns - report.t_ns))
    guided = model.corridor(
        report.state,
        report.guidance,
        age_s,
        outlook.horizon_s,
        otherwise_s=age_s if report.manoeuvre else 0.0,
    )
    if guided is None:
        return ()
    if report.manoeuvre is None:
        return (guided,)
    flown = model.corridor(report.state, report.intent(), age_s, outlook.horizon_s)
    return () if flown is None else (guided, flown)


def _apart(
    ways: Sequence[Corridor], others: Sequence[Corridor], outlook: Outlook, required: Required
) -> bool:
    """Whether all ways of one UAV for certain stay apart from all of another."""
    if not (ways and others):
        return False
    horizon_s, step_s = outlook.horizon_s, outlook.step_s
    return all(stay_apart(a, b, required, horizon_s, step_s) for a in ways for b in others)


def stay_apart(
    one: Corridor, other: Corridor, required: Required, horizon_s: float, step_s: float
) -> bool:
    """Whether the chords between samples of two ways for certain do not come too near."""
    until_s = min(horizon_s, one.until_s, other.until_s)
    if until_s == horizon_s:
        gap_m = max(one.low_m - other.high_m, other.low_m - one.high_m)
        if gap_m > required.vertical_m + ROUNDING_M:
            return True
    needed_m = required.horizontal_m + one.stray_m + other.stray_m + ROUNDING_M
    north, east = other.north_m - one.north_m, other.east_m - one.east_m
    to_north = other.to_north_mps - one.to_north_mps
    to_east = other.to_east_mps - one.to_east_mps
    square, towards = to_north * to_north + to_east * to_east, north * to_north + east * to_east
    if towards >= 0.0:
        nearest_s = 0.0
    elif -towards < until_s * square:
        nearest_s = -towards / square
    else:
        nearest_s = until_s
    north_then, east_then = north + nearest_s * to_north, east + nearest_s * to_east
    if north_then * north_then + east_then * east_then <= needed_m * needed_m:
        return False
    if until_s == horizon_s:
        return True
    # From the last sample before on, all samples and the chords between them are in a circle.
    last_s = max(0.0, until_s - step_s)
    north, east = north + last_s * to_north, east + last_s * to_east
    reach_m = (one.fastest_mps + other.fastest_mps) * (horizon_s - last_s)
    return math.sqrt(north * north + east * east) > needed_m + reach_m


def level_near_s(one: Corridor, other: Corridor, required: Required) -> float:
    """Until when two ways for certain are not nearer than required in the plane; inf: always.

    As far as both corridors hold.
    """
    needed_m = required.horizontal_m + one.stray_m + other.stray_m + ROUNDING_M
    north, east = other.north_m - one.north_m, other.east_m - one.east_m
    to_north = other.to_north_mps - one.to_north_mps
    to_east = other.to_east_mps - one.to_east_mps
    square, towards = to_north * to_north + to_east * to_east, north * to_north + east * to_east
    beyond = north * north + east * east - needed_m * needed_m
    if beyond <= 0.0:
        return 0.0
    root = towards * towards - square * beyond
    return math.inf if towards >= 0.0 or root <= 0.0 else (-towards - math.sqrt(root)) / square
