"""What the geometric resolver chooses among, and how it measures that.

`Options` are the members of the command sets (eq. 7), in the families in which they are tried.
`Geometry` predicts trajectories and holds them against those of `Others`: first overlap, clearance,
least separation. With `resolution.growth_mps` and `vertical_growth_mps` the zone to be kept grows
with the age of what is known of a pair; positions relative to it are then scaled so that the grown
cylinder becomes the required one, and all tests stay as they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.resolvers import FAR, Aircraft
from fleet.model.flight import State
from fleet.model.risk import Growth, first_overlap_s, normalised_separation
from fleet.model.scenario import Resolution, Scenario
from fleet.model.tracks import courses_of
from fleet.model.trajectory import Aim, Array, climb_commands, command_set, turn_commands

BETWEEN = np.linspace(0.0, 1.0, 17)
"""Where on the chord between two samples the least separation is sought."""


@dataclass(frozen=True, slots=True)
class Option:
    """One member of the command sets: tc and cc, and which of them it takes over from guidance."""

    manoeuvre: str
    turn_rad: float
    climb_mps: float


class Options:
    """All options that the scenario allows."""

    def __init__(self, rules: Resolution) -> None:
        self.widest_rad = math.radians(rules.max_turn_deg)
        self.steepest_mps = max(rules.max_climb_mps, rules.max_dive_mps)
        turns = turn_commands(self.widest_rad, rules.turn_options)
        climbs = climb_commands(rules.max_dive_mps, rules.max_climb_mps, rules.climb_options)
        family = command_set(turns, climbs)
        self._turns = [Option("turn", tc, 0.0) for tc, _ in family if tc]
        self._climbs = [Option("climb", 0.0, cc) for _, cc in family if cc]
        self._both = [
            Option("turn_climb", t.turn_rad, c.climb_mps) for t in self._turns for c in self._climbs
        ]

    def families(self, axis: str, climbing: bool) -> list[tuple[str, list[Option]]]:
        """The option families in the order in which they are tried.

        Level flight is an escape only for a UAV whose guidance climbs or dives.
        """
        level = [Option("climb", 0.0, 0.0)] if climbing else []
        turns, climbs = self._turns, [*self._climbs, *level]
        first, second = (turns, climbs) if axis == "turn" else (climbs, turns)
        return [("axis", first), ("other", second), ("both", self._both)]


@dataclass(frozen=True, slots=True)
class Others:
    """Trajectories (k, n, 3) of those to keep clear of.

    `scale` (k, 1, 3) turns the zone to be kept from each into the required one; None if no zone
    grows.
    """

    paths: Array
    scale: Array | None = None

    def __len__(self) -> int:
        """How many they are."""
        return len(self.paths)

    def relative_m(self, paths: Array) -> Array:
        """Paths (m, n, 3) as seen from each of them, scaled: shape (m, k, n, 3).

        Of longer trajectories than `paths` only the first n samples count.
        """
        return scaled(paths[:, None] - self.paths[None, :, : paths.shape[1]], self.scale)


def scaled(relative_m: Array, scale: Array | None) -> Array:
    """Relative positions times a scale, if there is one."""
    return relative_m if scale is None else relative_m * scale


class Geometry:
    """Trajectories of a scenario's UAVs, and what they are worth."""

    def __init__(self, scenario: Scenario) -> None:
        r = scenario.resolution
        self._scenario = scenario
        self._alert = scenario.outlook()
        self.outlook = scenario.escape_outlook()
        self.required = scenario.required()
        self.growth = Growth(r.growth_mps, r.vertical_growth_mps)
        self._floor_down_m = -r.min_altitude_m

    def positions(self, states: Sequence[State], aims: Sequence[Aim]) -> Array:
        """Trajectories over 2 T_s, shape (m, n, 3)."""
        outlook = self.outlook
        return outlook.predictor.positions(courses_of(states, aims), outlook.times_s)

    def scale(self, ages_s: Sequence[float]) -> Array | None:
        """`Others.scale` for pairs known with these ages."""
        return self.growth.scale(self.required, np.array(ages_s)[:, None]) if self.growth else None

    def overlaps(self, paths: Array, others: Others) -> Array:
        """First overlap, with margin, of paths (m, n, 3) with the others: shape (m, k)."""
        relative = others.relative_m(paths)
        return first_overlap_s(relative, self.outlook.times_s, self.outlook.required)

    def first_alert_s(self, path: Array, others: Others) -> float:
        """First overlap of a path (n, 3) with any other within T_s, without margin; inf if none."""
        if not len(others):
            return math.inf
        times = self._alert.times_s
        relative = others.relative_m(path[None, : len(times)])
        return float(first_overlap_s(relative, times, self._alert.required).min())

    def clear(self, path: Array, others: Others) -> bool:
        """Whether a path (n, 3) keeps the zone, if not the margin, all along."""
        relative = others.relative_m(path[None])
        first = first_overlap_s(relative, self.outlook.times_s, self._alert.required)
        return bool(np.isinf(first).all())

    def ranks(self, paths: Array, others: Others) -> Array:
        """How good paths without a safe one among them are, shape (m,).

        The least separation; where options share it (zones that overlap already), how far apart
        the rest of the path is.
        """
        nearest = normalised_separation(others.relative_m(paths), self.required).min(axis=1)
        later = np.minimum(nearest, 2.0).mean(axis=1)
        return np.asarray(nearest.min(axis=1) + 0.02 * later, dtype=np.float64)

    def least_separation(self, path: Array, others: Others, alert: bool = False) -> float:
        """Least normalised separation of a path (n, 3) from all others, whatever their zones.

        With `alert` within T_s only.
        """
        if not len(others):
            return FAR
        count = len(self._alert.times_s) if alert else len(path)
        relative = path[:count] - others.paths[:, :count]
        steps = np.diff(relative, axis=1)[:, :, None] * BETWEEN[:, None]
        return float(normalised_separation(relative[:, :-1, None] + steps, self.required).min())

    def above_ground(self, paths: Array) -> NDArray[np.bool_]:
        """Which paths never sink below the least altitude, or below where they start."""
        floor = np.maximum(self._floor_down_m, paths[:, :1, 2])
        return np.asarray((paths[..., 2] <= floor + 1e-6).all(axis=1))

    def escape_times_s(
        self,
        aircraft: Aircraft,
        aim: Aim,
        others: Iterable[tuple[State, Aim]],
        scale: Array | None = None,
    ) -> tuple[float, float]:
        """Escape and intercept time: from when guidance may fly again safely, and is back on plan.

        2 T_s stands for an escape that is not over within it.
        """
        outlook = self.outlook
        times = outlook.times_s
        stride = max(1, round(1.0 / (times[1] - times[0])))
        starts = np.arange(0, len(times), stride)
        course = courses_of([aircraft.state] * len(starts), [aim] * len(starts))
        states = outlook.predictor.states(course, times[starts])
        pilot = self._scenario.pilot(aircraft.state.speed_mps)
        back = courses_of(states, [pilot.aim(aircraft.plan, s) for s in states])
        chosen = len(starts) - 1
        pairs = list(others)
        if pairs:
            doubled = np.concatenate([times, times[1:] + times[-1]])
            far = outlook.predictor.positions(courses_of(*zip(*pairs, strict=True)), doubled)
            windows = np.stack([far[:, k : k + len(times)] for k in starts])
            apart = outlook.predictor.positions(back, times)[:, None] - windows
            first = first_overlap_s(scaled(apart, scale), times, outlook.required)
            free = np.isinf(first).all(axis=1)
            chosen = int(np.argmax(free)) if free.any() else chosen
        else:
            chosen = 0
        turn = float(outlook.predictor.turn_time_s(back)[chosen])
        level, settings = aircraft.guidance.level_down_m, pilot.settings
        height = abs(states[chosen].down_m - level) if not math.isnan(level) else 0.0
        climb = height / settings.climb_mps + (2.0 * settings.level_off_s if height > 1.0 else 0.0)
        escape = float(times[starts[chosen]])
        return escape, escape + max(turn, climb)
