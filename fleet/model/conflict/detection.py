"""Conflict detection: which pairs of UAVs will come too near within the horizon, and how soon.

In three steps, each for those that the one before has left: boxes round all that a UAV can reach;
those who fly straight on and level in closed form; the others by samples of their trajectories.
With a few UAVs the second step is left out; and all of them, where nobody can be at risk (`apart`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.model.conflict.apart import all_apart
from fleet.model.conflict.boxes import Places, overlapping
from fleet.model.conflict.risk import Required, first_overlap_s
from fleet.model.conflict.tracks import StateReport, ages_s, fastest_mps, states_at
from fleet.model.elementary import sincos
from fleet.model.types import Array, Pair
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.fleet_models import FleetModels

FEW_UAVS = 12
"""For so few it takes longer to find out who flies straight on than to compare samples."""

AT_ONCE = 4096
"""So many pairs of sampled trajectories are compared at a time, for the sake of memory."""


@dataclass(frozen=True, slots=True)
class Outlook:
    """How far ahead, how finely and with what separation conflicts are sought."""

    models: FleetModels
    times_s: Array
    required: Required

    @property
    def horizon_s(self) -> float:
        """T_s."""
        return float(self.times_s[-1])


def conflicts(reports: Sequence[StateReport], now_ns: int, outlook: Outlook) -> dict[Pair, float]:
    """Pairs (lower ID first) at risk within the horizon from `now_ns`, and how soon, in s.

    A pair is at risk when what either flies, or what its guidance would fly if released, overlaps
    with either of the other's: a group lasts until its manoeuvres can be ended safely.
    """
    if len(reports) < 2:
        return {}
    few = len(reports) <= FEW_UAVS
    if few and _all_apart(reports, now_ns, outlook):
        return {}
    search = _by_samples if few else _in_steps
    first, second, found = search(reports, now_ns, outlook)
    out: dict[Pair, float] = {}
    for k in np.flatnonzero(np.isfinite(found)):
        lower, higher = sorted((reports[int(first[k])].id, reports[int(second[k])].id))
        out[lower, higher] = float(found[k])
    return out


def trajectories(reports: Sequence[StateReport], now_ns: int, outlook: Outlook) -> Array:
    """What each UAV flies from `now_ns` on, going by its report: shape (m, n, 3)."""
    intents = [r.intent() for r in reports]
    uavs, states = [r.id for r in reports], [r.state for r in reports]
    times = ages_s(reports, now_ns)[:, None] + outlook.times_s
    return outlook.models.positions(uavs, states, intents, times)


def released(reports: Sequence[StateReport], now_ns: int, outlook: Outlook) -> Array:
    """What the guidance of each UAV would fly from `now_ns` on: shape (m, n, 3)."""
    states = states_at(reports, now_ns, outlook.models)
    ages = ages_s(reports, now_ns).tolist()
    wanted = [r.guidance.after(age) for r, age in zip(reports, ages, strict=True)]
    return outlook.models.positions([r.id for r in reports], states, wanted, outlook.times_s)


def _all_apart(reports: Sequence[StateReport], now_ns: int, outlook: Outlook) -> bool:
    step_s = float(outlook.times_s[1])
    return all_apart(reports, now_ns, outlook.models, outlook.required, outlook.horizon_s, step_s)


def _by_samples(
    reports: Sequence[StateReport], now_ns: int, outlook: Outlook
) -> tuple[Places, Places, Array]:
    """Places of pairs, and when they first overlap: samples of all that are near each other."""
    low, high = _within_reach(reports, ages_s(reports, now_ns), outlook)
    half = _half(outlook.required)
    first, second = overlapping(low - half, high + half)
    return first, second, _sampled_overlaps_s(reports, now_ns, (first, second), outlook)


def _in_steps(
    reports: Sequence[StateReport], now_ns: int, outlook: Outlook
) -> tuple[Places, Places, Array]:
    """The same in the steps that pay for many."""
    ages = ages_s(reports, now_ns)
    straight, start, end = _straight_ways(reports, ages, outlook)
    low, high = np.minimum(start, end), np.maximum(start, end)
    bent = np.flatnonzero(~straight)
    if len(bent):
        known = [reports[k] for k in bent.tolist()]
        low[bent], high[bent] = _within_reach(known, ages[bent], outlook)
    half = _half(outlook.required)
    first, second = overlapping(low - half, high + half)
    found = np.empty(len(first))
    plain = straight[first] & straight[second]
    one, two = first[plain], second[plain]
    ways = np.stack([start, end], axis=1)
    found[plain] = _overlaps_s([ways], one, two, outlook.times_s[[0, -1]], outlook.required)
    one, two = first[~plain], second[~plain]
    found[~plain] = _sampled_overlaps_s(reports, now_ns, (one, two), outlook)
    return first, second, found


def _straight_ways(
    reports: Sequence[StateReport], ages: Array, outlook: Outlook
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Who flies straight on and level for all of the horizon, and from where to where, (N, 3)."""
    course = courses((r.state, r.guidance) for r in reports)
    straight = outlook.models.straight([r.id for r in reports], course)
    straight &= np.array([r.manoeuvre is None for r in reports])
    later = course.later
    if later is not None:
        straight[later.rows] &= later.after_s > ages[later.rows] + outlook.horizon_s
    place = np.stack([course.north_m, course.east_m, course.down_m], axis=1)
    speed, heading = course.speed_mps, course.heading_rad
    sine, cosine = sincos(heading)
    ahead = np.stack([speed * cosine, speed * sine, 0.0 * speed], axis=1)
    start = place + ages[:, None] * ahead
    return straight, start, start + outlook.horizon_s * ahead


def _within_reach(
    reports: Sequence[StateReport], ages: Array, outlook: Outlook
) -> tuple[Array, Array]:
    """The corners (N, 3) of a box round all that is within reach of each at its speed."""
    table = np.array(
        [(*r.state.position_ned_m, fastest_mps(r.state, r.guidance, r.manoeuvre)) for r in reports]
    )
    place, fastest = table[:, :3], table[:, 3]
    reach = (fastest * (outlook.horizon_s + ages))[:, None]
    return place - reach, place + reach


def _half(required: Required) -> Array:
    """By how much boxes must be larger than what is reached, for both of a pair together."""
    return 0.5 * np.array([required.horizontal_m, required.horizontal_m, required.vertical_m])


def _sampled_overlaps_s(
    reports: Sequence[StateReport], now_ns: int, pairs: tuple[Places, Places], outlook: Outlook
) -> Array:
    """When pairs first overlap, by samples of what they fly and would fly (inf: not at all)."""
    first, second = pairs
    if not len(first):
        return np.empty(0)
    involved = np.zeros(len(reports), dtype=np.bool_)
    involved[first] = involved[second] = True
    picked = [r for r, there in zip(reports, involved, strict=True) if there]
    ways = [trajectories(picked, now_ns, outlook)]
    if any(r.manoeuvre for r in picked):
        ways.append(released(picked, now_ns, outlook))
    row = np.add.accumulate(involved, dtype=np.intp) - 1
    parts = [slice(k, k + AT_ONCE) for k in range(0, len(first), AT_ONCE)]
    found = [
        _overlaps_s(ways, row[first[p]], row[second[p]], outlook.times_s, outlook.required)
        for p in parts
    ]
    return np.concatenate(found)


def _overlaps_s(
    ways: Sequence[Array], one: Places, two: Places, times_s: Array, required: Required
) -> Array:
    """When any way of one first overlaps with any of the other; `ways` are (N, n, 3) each."""
    if len(ways) == 1:
        return first_overlap_s(ways[0][one] - ways[0][two], times_s, required)
    relative = np.stack([own[one] - other[two] for own in ways for other in ways])
    overlaps: Array = first_overlap_s(relative, times_s, required).min(axis=0)
    return overlaps
