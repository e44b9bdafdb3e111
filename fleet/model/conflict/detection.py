"""Conflict detection: which pairs of UAVs will come too near within the horizon, and how soon.

In steps, each for those pairs that the one before has left: boxes round all that a UAV can reach;
those who fly straight on and level in closed form; who stays apart for certain (`apart`); the
others by samples of their trajectories. With a few UAVs all pairs are asked first who of them is
apart. What is found of a pair is the same to the last bit whoever else is there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fleet.model.conflict.apart import Place, in_doubt
from fleet.model.conflict.boxes import Places, overlapping
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import first_overlap_s
from fleet.model.conflict.tracks import StateReport, ages_s, fastest_mps, states_at
from fleet.model.elementary import sincos
from fleet.model.types import Array, Pair
from fleet.model.vehicle.courses import courses

FEW_UAVS = 12
"""Of so few every pair is asked whether it is apart, sooner than boxes are compared."""

AT_ONCE = 4096
"""So many pairs of sampled trajectories are compared at a time, for the sake of memory."""

Overlaps = dict[Place, float]
"""When pairs first overlap, in s, of those that do."""


@dataclass(frozen=True, slots=True)
class StraightWays:
    """Who of N flies straight on and level for all of the horizon, and from where to where (N, 3).

    Of who does not, where it would be is of no meaning.
    """

    straight: NDArray[np.bool_]
    start: Array
    end: Array


def conflicts(
    reports: Sequence[StateReport],
    now_ns: int,
    outlook: Outlook,
    *,
    sure: Collection[Pair] = (),
) -> dict[Pair, float]:
    """Pairs (lower ID first) at risk within the horizon from `now_ns`, and how soon, in s.

    A pair is at risk when what either flies, or what its guidance would fly if released, overlaps
    with either of the other's: a group lasts until its manoeuvres can be ended safely. Those that
    are `sure` to be at risk need not be found.
    """
    few = len(reports) <= FEW_UAVS
    plain, bent = (_of_few if few else _of_many)(reports, now_ns, outlook, sure)
    found = {**plain, **_sampled_overlaps_s(reports, now_ns, bent, outlook)}
    out: dict[Pair, float] = {}
    for (i, j), first_s in sorted(found.items()):
        lower, higher = sorted((reports[i].id, reports[j].id))
        out[lower, higher] = first_s
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


def _of_few(
    reports: Sequence[StateReport], now_ns: int, outlook: Outlook, sure: Collection[Pair]
) -> tuple[Overlaps, list[Place]]:
    """The pairs at risk of which both fly straight on, and those that are left to the samples."""
    pairs = _unsure(reports, combinations(range(len(reports)), 2), sure)
    pairs = in_doubt(reports, pairs, now_ns, outlook)
    if not pairs:
        return {}, []
    first, second = np.array(pairs, dtype=np.intp).T
    ways = _straight_ways(reports, now_ns, outlook)
    return _straight_overlaps_s(reports, ways, (first, second), outlook)


def _of_many(
    reports: Sequence[StateReport], now_ns: int, outlook: Outlook, sure: Collection[Pair]
) -> tuple[Overlaps, list[Place]]:
    """The same, by boxes first."""
    ways = _straight_ways(reports, now_ns, outlook)
    low, high = np.minimum(ways.start, ways.end), np.maximum(ways.start, ways.end)
    bent = np.flatnonzero(~ways.straight)
    if len(bent):
        known = [reports[k] for k in bent.tolist()]
        low[bent], high[bent] = _within_reach(known, ages_s(known, now_ns), outlook)
    half = outlook.zones.halves_m([r.id for r in reports], outlook.required)
    first, second = overlapping(low - half, high + half)
    found, left = _straight_overlaps_s(reports, ways, (first, second), outlook)
    return found, in_doubt(reports, _unsure(reports, left, sure), now_ns, outlook)


def _unsure(
    reports: Sequence[StateReport], places: Iterable[Place], sure: Collection[Pair]
) -> list[Place]:
    """Those places of pairs of which it is not sure that they are at risk."""
    if not sure:
        return list(places)
    ids = [r.id for r in reports]
    pairs = ((place, sorted((ids[place[0]], ids[place[1]]))) for place in places)
    return [place for place, (lower, higher) in pairs if (lower, higher) not in sure]


def _straight_overlaps_s(
    reports: Sequence[StateReport],
    ways: StraightWays,
    pairs: tuple[Places, Places],
    outlook: Outlook,
) -> tuple[Overlaps, list[Place]]:
    """When those pairs first overlap of which both fly straight on, and the other pairs."""
    first, second = pairs
    plain = ways.straight[first] & ways.straight[second]
    paths = np.stack([ways.start, ways.end], axis=1)
    one, two = first[plain], second[plain]
    ends_s = outlook.times_s[[0, -1]]
    relative = _scaled(paths[one] - paths[two], _of_ids(reports, one, two), outlook)
    overlap_s = first_overlap_s(relative, ends_s, outlook.required)
    return _at_risk(one, two, overlap_s), _as_pairs(first[~plain], second[~plain])


def _straight_ways(reports: Sequence[StateReport], now_ns: int, outlook: Outlook) -> StraightWays:
    ages = ages_s(reports, now_ns)
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
    return StraightWays(straight, start, start + outlook.horizon_s * ahead)


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


def _sampled_overlaps_s(
    reports: Sequence[StateReport], now_ns: int, pairs: Sequence[Place], outlook: Outlook
) -> Overlaps:
    """When pairs first overlap, by samples of what they fly and would fly."""
    if not pairs:
        return {}
    places = sorted({place for pair in pairs for place in pair})
    flying = [place for place in places if reports[place].manoeuvre]
    paths = trajectories([reports[place] for place in places], now_ns, outlook)
    if flying:
        free = released([reports[place] for place in flying], now_ns, outlook)
        paths = np.concatenate([paths, free])
    rows: dict[int, list[int]] = {place: [] for place in places}
    for row, place in enumerate([*places, *flying]):
        rows[place].append(row)
    out: Overlaps = {}
    for start in range(0, len(pairs), AT_ONCE):
        part = pairs[start : start + AT_ONCE]
        meets = [(n, a, b) for n, (i, j) in enumerate(part) for a in rows[i] for b in rows[j]]
        which, one, two = np.array(meets, dtype=np.intp).T
        first, second = np.array(part, dtype=np.intp).T
        ids = _of_ids(reports, first[which], second[which])
        relative = _scaled(paths[one] - paths[two], ids, outlook)
        overlap_s = first_overlap_s(relative, outlook.times_s, outlook.required)
        first_s = np.full(len(part), np.inf)
        np.minimum.at(first_s, which, overlap_s)
        out |= _at_risk(first, second, first_s)
    return out


def _of_ids(reports: Sequence[StateReport], first: Places, second: Places) -> Iterator[Pair]:
    """The IDs of pairs that are told as places of reports."""
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        yield reports[i].id, reports[j].id


def _scaled(relative_m: Array, pairs: Iterable[Pair], outlook: Outlook) -> Array:
    """Relative positions (p, n, 3), in proportion to what each pair requires."""
    if outlook.zones.larger:
        scale = outlook.zones.scale(list(pairs), outlook.required)
        assert scale is not None
        relative_m = relative_m * scale
    return relative_m


def _at_risk(first: Places, second: Places, overlap_s: Array) -> Overlaps:
    """Those pairs that overlap at all."""
    there = np.isfinite(overlap_s)
    pairs = _as_pairs(first[there], second[there])
    return dict(zip(pairs, overlap_s[there].tolist(), strict=True))


def _as_pairs(first: Places, second: Places) -> list[Place]:
    return list(zip(first.tolist(), second.tolist(), strict=True))
