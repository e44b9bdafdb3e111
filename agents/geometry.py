"""How the geometric resolver measures what it chooses among.

`Geometry` predicts trajectories and holds them against those of `Others`: first overlap, clearance,
least separation. With `resolution.growth_mps` and `vertical_growth_mps` the zone to be kept grows
with the age of what is known of a pair; positions relative to it are then scaled so that the grown
cylinder becomes the required one, and all tests stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.agents.advisory import Aircraft, Candidate
from fleet.agents.candidates import LEVELS_EACH_SIDE, Levels
from fleet.agents.ways_home import WaysHome
from fleet.config.scenario import Scenario
from fleet.model.conflict.apart import ROUNDING_M, level_near_s, stay_apart
from fleet.model.conflict.blocks import (
    FEW_PAIRS,
    chords_within,
    first_overlaps_s,
    least_separations,
)
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import FAR, Growth, first_overlap_s
from fleet.model.conflict.tracks import intent_of
from fleet.model.elementary import hypot
from fleet.model.types import Array, Pair, Position
from fleet.model.vehicle.corridors import Corridor
from fleet.model.vehicle.courses import courses
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import Pilot
from fleet.model.vehicle.intent import Intent
from fleet.model.words import AVOIDING

CANDIDATE_MANOEUVRES = ("", *AVOIDING)
"""What can be flown; the first is guidance."""

RETURNS = 10
"""At so many moments of a manoeuvre it is tried whether it can end."""

STARTS = 8
"""Of the moments at which a manoeuvre could end so many are looked at together, or some more."""

CLEAR_M = 1.0
"""Levelling off is asymptotic: this far beyond the distance required, so that it comes to pass."""

SAME_S = 1e-9
"""Times nearer to each other are the same, but for rounding."""


Way = tuple[Aircraft, Corridor]
"""A UAV, and the corridor in which it flies what it flies."""


@dataclass(frozen=True, slots=True)
class Others:
    """Trajectories (k, n, 3) of those to keep clear of.

    `scale` (k, 1, 3) turns the zone to be kept from each into the required one; None if no zone
    grows or is larger than another. `ratio_scale` is that without growth.
    """

    paths: Array
    scale: Array | None = None
    ratio_scale: Array | None = None

    def __len__(self) -> int:
        """How many they are."""
        return len(self.paths)

    def relative_m(self, paths: Array) -> Array:
        """Paths (m, n, 3) as seen from each of them, scaled: shape (m, k, n, 3).

        Of longer trajectories than `paths` only the first n samples count.
        """
        return to_units(paths[:, None] - self.paths[None, :, : paths.shape[1]], self.scale)


def _clear(
    z: Array, near: NDArray[np.bool_], keep_m: Array, start: float
) -> tuple[list[float], list[float]]:
    """The next altitudes above and below `start` that are clear of z (k, n) where that is near."""
    met = near.any(axis=1)
    high = (np.where(near, z, np.inf).min(axis=1) - keep_m)[met]
    low = (np.where(near, z, -np.inf).max(axis=1) + keep_m)[met]
    up = [-edge for edge in _edges(-low, -high, -start)]
    return up, _edges(high, low, start)


def _edges(top: Array, bottom: Array, start: float) -> list[float]:
    """The first edges beyond `start` of bands from top to bottom, laid together (top < bottom)."""
    order = np.argsort(top, kind="stable")
    merged: list[list[float]] = []
    for low, high in zip(top[order].tolist(), bottom[order].tolist(), strict=True):
        if merged and low <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    return [edge for band in merged for edge in band if edge > start][:LEVELS_EACH_SIDE]


def _columns(
    rest: Sequence[tuple[int, State, Intent]],
) -> tuple[list[int], list[State], list[Intent]]:
    """IDs, states and intents of several UAVs."""
    uavs, states, intents = zip(*rest, strict=True)
    return list(uavs), list(states), list(intents)


def to_units(relative_m: Array, scale: Array | None) -> Array:
    """Relative positions times a scale, if there is one."""
    return relative_m if scale is None else relative_m * scale


class Geometry:
    """Trajectories of a scenario's UAVs, and what they are worth."""

    def __init__(self, scenario: Scenario) -> None:
        r = scenario.resolution
        self._scenario = scenario
        self._models = scenario.models()
        self._alert = scenario.outlook()
        self.outlook = scenario.manoeuvre_outlook()
        self._returns = scenario.manoeuvre_outlook(every=2)
        self.free_for_s = {m: 2.0 * scenario.ahead_s(m) + SAME_S for m in CANDIDATE_MANOEUVRES}
        self.required, self.zones = scenario.required(), scenario.zone_ratios()
        self.growth = Growth(r.growth_mps, r.vertical_growth_mps)
        self._altitudes = scenario.altitudes()
        last = self._samples(max(map(self.alert_for_s, AVOIDING))) - 1
        self._alert_ends_s = float(self.outlook.times_s[last])
        self._latest_far: dict[int, tuple[Sequence[tuple[int, State, Intent]], Array]] = {}

    def positions(
        self, uavs: Sequence[int], states: Sequence[State], intents: Sequence[Intent]
    ) -> Array:
        """Trajectories over 2 T_s, shape (m, n, 3)."""
        return self._models.positions(uavs, states, intents, self.outlook.times_s)

    def scale(self, pairs: Sequence[Pair], ages_s: Sequence[float]) -> Array | None:
        """`Others.scale` for pairs known with these ages."""
        return self.zones.scale(pairs, self.required, self.growth, ages_s)

    def ratio_scale(self, pairs: Sequence[Pair]) -> Array | None:
        """`Others.ratio_scale` for pairs."""
        return self.zones.scale(pairs, self.required)

    def overlaps(self, paths: Array, others: Others) -> Array:
        """First overlap, with margin, of paths (m, n, 3) with the others: shape (m, k)."""
        times, required = self.outlook.times_s, self.outlook.required
        if others.scale is not None or len(paths) * len(others) <= FEW_PAIRS:
            return first_overlaps_s(paths[:, None], others.paths, times, required, others.scale)
        near = chords_within(paths, others.paths, required, 1.0).any(axis=1)
        first = np.full((len(paths), len(others)), np.inf)
        if near.any():
            first[:, near] = first_overlaps_s(paths[:, None], others.paths[near], times, required)
        return first

    def first_overlaps_s(
        self, candidates: Sequence[Candidate], paths: Array, others: Others
    ) -> Array:
        """First overlap of each candidate's path with anybody, with margin, shape (m,).

        Inf if there is none within twice what it is looked at for.
        """
        if not len(others):
            return np.full(len(paths), np.inf)
        first = self.overlaps(paths, others).min(axis=1)
        ends_s = np.array([self.free_for_s[c.manoeuvre] for c in candidates])
        return np.asarray(np.where(first > ends_s, np.inf, first))

    def first_overlap_s(self, relative_m: Array, *, alert: bool) -> Array:
        """First overlap of relative trajectories (m, n, 3), shape (m,).

        With margin, or for an alert without; and then it need be looked no further than for that.
        """
        if not alert:
            return first_overlap_s(relative_m, self.outlook.times_s, self.outlook.required)
        times = self.outlook.times_s[: self._samples(self._alert_ends_s)]
        return first_overlap_s(relative_m[:, : len(times)], times, self._alert.required)

    def alert_for_s(self, manoeuvre: str) -> float:
        """How far ahead an overlap raises an alert: T_s, T_H for what climbs."""
        # A broadcast with flipped bits may name a manoeuvre that nobody flies: then it is guidance.
        return 0.5 * self.free_for_s.get(manoeuvre, self.free_for_s[""])

    def alerts_in_full(self, manoeuvre: str) -> bool:
        """Whether that a manoeuvre raises no alert says so for T_s, and not for a shorter time."""
        return self.alert_for_s(manoeuvre) >= self.alert_for_s("")

    def corridor(self, craft: Aircraft) -> Corridor | None:
        """A corridor of what a UAV flies, for as long as an alert is raised; None: not known."""
        flown = intent_of(craft.guidance, craft.manoeuvre)
        return self._models.of(craft.id).corridor(craft.state, flown, 0.0, self._alert_ends_s)

    def surely_no_alert(self, one: Way, other: Way) -> bool:
        """Whether no alert is raised between two UAVs, by their corridors.

        Where they come near in the plane they may have climbed out of each other's way by then.
        """
        (_, ahead), (_, its) = one, other
        ends_s, step_s = self._alert_ends_s, self.outlook.step_s
        required = self._alert.required_of((one[0].id, other[0].id))
        if stay_apart(ahead, its, required, ends_s, step_s):
            return True
        near_s = level_near_s(ahead, its, required) - step_s  # from the sample before on
        if near_s <= 0.0 or min(ahead.until_s, its.until_s) < ends_s:
            return False
        (low, high), (its_low, its_high) = (self._downs(way, near_s) for way in (one, other))
        return max(low - its_high, its_low - high) > required.vertical_m + ROUNDING_M

    def _downs(self, way: Way, after_s: float) -> tuple[float, float]:
        """Between which down stays from a time on until an alert is no longer raised."""
        craft, corridor = way
        if corridor.low_m == corridor.high_m:
            return corridor.low_m, corridor.high_m
        model, intent = self._models.of(craft.id), intent_of(craft.guidance, craft.manoeuvre)
        state = model.after(craft.state, intent, after_s)
        rest = model.corridor(state, intent.after(after_s), 0.0, self._alert_ends_s - after_s)
        return (-math.inf, math.inf) if rest is None else (rest.low_m, rest.high_m)

    def place_after(self, craft: Aircraft, intent: Intent, time_s: float) -> Position:
        """Where a UAV is that has flown an intent for so long."""
        return self._models.of(craft.id).after(craft.state, intent, time_s).position_ned_m

    def first_alert_s(self, path: Array, others: Others, manoeuvre: str = "") -> float:
        """First overlap of a path (n, 3) with any other, without margin, within T_s; inf if none.

        Of one that climbs, within T_H.
        """
        if not len(others):
            return math.inf
        ahead_s = self.alert_for_s(manoeuvre)
        times = self.outlook.times_s[: self._samples(ahead_s)]
        relative = others.relative_m(path[None, : len(times)])
        first = float(first_overlap_s(relative, times, self._alert.required).min())
        return first if first <= ahead_s else math.inf

    def clear(self, path: Array, others: Others, manoeuvre: str) -> bool:
        """Whether a path (n, 3) keeps the zone, if not the margin, as long as it must be free."""
        relative = others.relative_m(path[None])
        first = first_overlap_s(relative, self.outlook.times_s, self._alert.required)
        return bool((first > self.free_for_s[manoeuvre]).all())

    def _samples(self, ahead_s: float) -> int:
        """How many samples of a path cover a time."""
        return int(np.searchsorted(self.outlook.times_s, ahead_s - SAME_S)) + 1

    def levels(self, path: Array, others: Others) -> Levels:
        """Altitudes clear of those who come within the horizontal distance of a path (n, 3).

        On a side where none of these is, of all the others: a manoeuvre that turns meets them.
        """
        z = others.paths[..., 2]
        apart = others.paths[..., :2] - path[:, :2]
        moved = np.diff(apart, axis=1)
        steps = hypot(moved[..., 0], moved[..., 1]).max(axis=1, initial=0.0)
        scale = np.ones((len(z), 3)) if others.scale is None else others.scale[:, 0]
        near_m = self.outlook.required.horizontal_m / scale[:, 0] + steps
        near = hypot(apart[..., 0], apart[..., 1]) < near_m[:, None]
        keep_m = self.outlook.required.vertical_m / scale[:, 2] + CLEAR_M
        start = float(path[0, 2])
        up, down = _clear(z, near, keep_m, start)
        if not (up and down):
            above, below = _clear(z, np.ones_like(near), keep_m, start)
            up, down = up or above, down or below
        level_off_s = self._scenario.guidance.level_off_s
        return Levels(start, tuple(up), tuple(down), level_off_s, self._altitudes)

    def least_separations(self, paths: Array, others: Others, *, alert: bool = False) -> Array:
        """Least normalised separation of paths (m, n, 3) from all others, as if no zone grew.

        Shape (m,). With `alert` within T_s only.
        """
        if not len(others):
            return np.full(len(paths), FAR)
        count = len(self._alert.times_s) if alert else paths.shape[1]
        there, scale = others.paths[:, :count], others.ratio_scale
        return least_separations(paths[:, :count], there, self.required, scale)

    def allowed(self, paths: Array) -> NDArray[np.bool_]:
        """Which paths stay between the least and the greatest altitude, or where they start."""
        floor = np.maximum(self._altitudes.floor_down_m, paths[:, :1, 2])
        ceiling = np.minimum(self._altitudes.ceiling_down_m, paths[:, :1, 2])
        down = paths[..., 2]
        return np.asarray(((down <= floor + 1e-6) & (down >= ceiling - 1e-6)).all(axis=1))

    def returning(
        self,
        aircraft: Aircraft,
        intents: Sequence[Intent],
        rest: Sequence[tuple[int, State, Intent]],
        scale: Array | None,
    ) -> Iterator[bool]:
        """Which of these manoeuvres can be ended safely within 2 T_s, one after the other.

        Coarser than `manoeuvre_times_s`: at `RETURNS` moments, and with every second sample.
        """
        if not rest:
            yield from [True] * len(intents)
            return
        outlook = self._returns
        times, count = outlook.times_s, len(outlook.times_s)
        starts = np.arange(0, count, max(1, round((count - 1) / RETURNS)))
        repeated = [intent for intent in intents for _ in starts]
        course = courses((aircraft.state, intent) for intent in repeated)
        model = self._models.of(aircraft.id)
        states = model.states(course, np.tile(times[starts], len(intents)))
        pilot, each = self._pilot(aircraft), range(0, len(states), len(starts))
        flights = [states[k : k + len(starts)] for k in each]
        aims = [aim for flown in flights for aim in pilot.intents(aircraft.plan, flown)]
        back = courses(zip(states, aims, strict=True))
        home = model.positions(back, times).reshape(len(intents), len(starts), count, 3)
        ways = WaysHome(outlook, self._far(rest, outlook), scale)
        for flown in home:
            yield ways.first_free(flown, starts) is not None

    def manoeuvre_times_s(
        self,
        aircraft: Aircraft,
        intent: Intent,
        others: Sequence[tuple[int, State, Intent]],
        scale: Array | None = None,
    ) -> tuple[float, float]:
        """Manoeuvre and intercept time: from when guidance may fly again, and is back on plan.

        2 T_s stands for a manoeuvre that is not over within it.
        """
        times = self.outlook.times_s
        starts = np.arange(0, len(times), max(1, round(1.0 / (times[1] - times[0]))))
        model, pilot = self._models.of(aircraft.id), self._pilot(aircraft)
        ways = WaysHome(self.outlook, self._far(others, self.outlook), scale)
        states = model.states(courses([(aircraft.state, intent)] * len(starts)), times[starts])
        aims = pilot.intents(aircraft.plan, states)
        at_once = max(STARTS, FEW_PAIRS // max(1, len(others)))
        for k in range(0, len(starts), at_once):
            part = slice(k, k + at_once)
            back = courses((state, next(aims)) for state in states[part])
            free = ways.first_free(model.positions(back, times), starts[part])
            if free is not None:
                break
        end = len(starts) - 1 if free is None else k + free
        turn = float(model.turn_time_s(back)[end - k])
        level, settings = aircraft.guidance.level_down_m, pilot.settings
        height = abs(states[end].down_m - level) if not math.isnan(level) else 0.0
        climb = height / settings.climb_mps + (2.0 * settings.level_off_s if height > 1.0 else 0.0)
        regain = abs(states[end].speed_mps - settings.speed_mps)
        faster = regain / pilot.limits.acceleration_mps2
        manoeuvre = float(times[starts[end]])
        return manoeuvre, manoeuvre + max(turn, climb, faster)

    def _far(self, others: Sequence[tuple[int, State, Intent]], outlook: Outlook) -> Array:
        """Trajectories of others for twice as long as an outlook, shape (k, 2n - 1, 3).

        The same others are asked for again and again while one UAV is resolved among them.
        """
        if not others:
            return np.empty(0)
        known = self._latest_far.get(len(outlook.times_s))
        if known is None or known[0] is not others:
            times = outlook.times_s
            doubled = np.concatenate([times, times[1:] + times[-1]])
            known = others, self._models.positions(*_columns(others), doubled)
            self._latest_far[len(times)] = known
        return known[1]

    def _pilot(self, aircraft: Aircraft) -> Pilot:
        return self._scenario.pilot(aircraft.id, aircraft.cruise_mps)
