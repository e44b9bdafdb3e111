"""The paper's resolution: eq. 10 (turns) and eq. 11 (climbs and dives), and what it leaves open.

One round goes through the group in ID order. Each UAV's options are compared with the trajectories
of all others: those already resolved in this round as resolved, the rest as they fly now. Options
are tried in stages, each only when the one before has no safe option:

    axis      the sector's axis: turns for head-on and rear, climbs for side encounters
    other     the other axis
    both      turn and climb together
    priority  as above, but leaving room only for those resolved before, not for those still to come
    tight     the option with the greatest least separation, where that is enough but for the margin
    least_bad the same where it is not enough: reported as unresolved

Where somebody's best is `least_bad`, the computing UAV manoeuvres too (stage `own`), and those are
tried again.

An alert is an overlap within T_s. What is chosen or returned to must be clear for twice as long and
by a margin, so that the next round does not have to undo it; an escape is kept until it raises an
alert itself, and ends once guidance's trajectory is free.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.resolvers import Advice, Aircraft, Situation
from fleet.model.flight import State
from fleet.model.guidance import guide
from fleet.model.risk import first_overlap_s, normalised_separation
from fleet.model.scenario import Scenario
from fleet.model.tracks import Escape, aim_of, courses_of
from fleet.model.trajectory import Aim, Array, climb_commands, command_set, turn_commands
from fleet.model.units import wrap_angle

LEVEL_MPS = 0.05
HEAD_ON = math.radians(30.0)
REAR = math.radians(150.0)


def sector_of(angle_rad: float) -> str:
    """head_on [-30, 30), right [30, 150), left [-150, -30) or rear, from the collision angle."""
    if -HEAD_ON <= angle_rad < HEAD_ON:
        return "head_on"
    if HEAD_ON <= angle_rad < REAR:
        return "right"
    return "left" if -REAR <= angle_rad < -HEAD_ON else "rear"


@dataclass(frozen=True, slots=True)
class Option:
    """One member of the command sets: tc and cc, and which of them it takes over from guidance."""

    manoeuvre: str
    turn_rad: float
    climb_mps: float


@dataclass(frozen=True, slots=True)
class Choice:
    """The option taken, with its trajectory and how it was found."""

    option: Option
    stage: str
    positions: Array
    aim: Aim
    least_separation: float
    safe_options: int


class GeometricResolver:
    """Chosen by `resolver = "geometric"`."""

    def __init__(self, scenario: Scenario) -> None:
        r = scenario.resolution
        self._scenario = scenario
        self._alert = scenario.outlook()
        self._outlook = scenario.escape_outlook()
        self._required = scenario.required()
        self._floor_down_m = -r.min_altitude_m
        turns = turn_commands(math.radians(r.max_turn_deg), r.turn_options)
        climbs = climb_commands(r.max_dive_mps, r.max_climb_mps, r.climb_options)
        family = command_set(turns, climbs)
        self.widest_rad = math.radians(r.max_turn_deg)
        self.steepest_mps = max(r.max_climb_mps, r.max_dive_mps)
        self._turns = [Option("turn", tc, 0.0) for tc, _ in family if tc]
        self._climbs = [Option("climb", 0.0, cc) for _, cc in family if cc]
        self._both = [
            Option("turn_climb", t.turn_rad, c.climb_mps) for t in self._turns for c in self._climbs
        ]

    def resolve(self, situation: Situation) -> Sequence[Advice]:
        """One round; see the module."""
        return _Round(self, situation).advise()

    def positions(self, states: Sequence[State], aims: Sequence[Aim]) -> Array:
        """Trajectories over 2 T_s, shape (m, n, 3)."""
        outlook = self._outlook
        return outlook.predictor.positions(courses_of(states, aims), outlook.times_s)

    def overlaps(self, paths: Array, others: Array) -> Array:
        """First overlap, with margin, of paths (m, n, 3) with others (k, n, 3): shape (m, k)."""
        relative = paths[:, None] - others[None]
        return first_overlap_s(relative, self._outlook.times_s, self._outlook.required)

    def first_alert_s(self, path: Array, others: Array) -> float:
        """First overlap of a path (n, 3) with any other within T_s, without margin; inf if none."""
        if not len(others):
            return math.inf
        n = len(self._alert.times_s)
        relative = path[None, :n] - others[:, :n]
        first = first_overlap_s(relative, self._alert.times_s, self._alert.required)
        return float(first.min())

    def least_separation(self, paths: Array, others: Array) -> Array:
        """Least normalised separation of each path from all others, shape (m,)."""
        if not len(others):
            return np.full(len(paths), 100.0)
        relative = paths[:, None] - others[None]
        separation = normalised_separation(relative, self._required)
        return np.asarray(separation.min(axis=(1, 2)), dtype=np.float64)

    def clear(self, path: Array, others: Array) -> bool:
        """Whether a path (n, 3) keeps the required separation, if not the margin, all along."""
        relative = path[None] - others
        first = first_overlap_s(relative, self._outlook.times_s, self._alert.required)
        return bool(np.isinf(first).all())

    def ranks(self, paths: Array, others: Array) -> Array:
        """How good paths without a safe one among them are, shape (m,).

        The least separation; where options share it (zones that overlap already), how far apart
        the rest of the path is.
        """
        relative = paths[:, None] - others[None]
        nearest = normalised_separation(relative, self._required).min(axis=1)
        later = np.minimum(nearest, 2.0).mean(axis=1)
        return np.asarray(nearest.min(axis=1) + 0.02 * later, dtype=np.float64)

    def families(self, axis: str, climbing: bool) -> list[tuple[str, list[Option]]]:
        """The option families in the order in which they are tried.

        Level flight is an escape only for a UAV whose guidance climbs or dives.
        """
        level = [Option("climb", 0.0, 0.0)] if climbing else []
        turns, climbs = self._turns, [*self._climbs, *level]
        first, second = (turns, climbs) if axis == "turn" else (climbs, turns)
        return [("axis", first), ("other", second), ("both", self._both)]

    def above_ground(self, paths: Array) -> NDArray[np.bool_]:
        """Which paths never sink below the least altitude, or below where they start."""
        floor = np.maximum(self._floor_down_m, paths[:, :1, 2])
        return np.asarray((paths[..., 2] <= floor + 1e-6).all(axis=1))

    def escape_times_s(
        self, aircraft: Aircraft, aim: Aim, others: Iterable[tuple[State, Aim]]
    ) -> tuple[float, float]:
        """Escape and intercept time: from when guidance may fly again safely, and is back on plan.

        2 T_s stands for an escape that is not over within it.
        """
        outlook = self._outlook
        times = outlook.times_s
        stride = max(1, round(1.0 / (times[1] - times[0])))
        starts = np.arange(0, len(times), stride)
        course = courses_of([aircraft.state] * len(starts), [aim] * len(starts))
        states = outlook.predictor.states(course, times[starts])
        settings = self._scenario.guidance_settings(aircraft.state.speed_mps)
        wanted = [guide(aircraft.plan, s, settings, self._scenario.limits()) for s in states]
        level = aircraft.guidance.level_down_m
        aims = [Aim(w.heading_rad, w.climb_mps, level) for w in wanted]
        back = courses_of(states, aims)
        chosen = len(starts) - 1
        pairs = list(others)
        if pairs:
            doubled = np.concatenate([times, times[1:] + times[-1]])
            far = outlook.predictor.positions(courses_of(*zip(*pairs, strict=True)), doubled)
            windows = np.stack([far[:, k : k + len(times)] for k in starts])
            relative = outlook.predictor.positions(back, times)[:, None] - windows
            free = np.isinf(first_overlap_s(relative, times, outlook.required)).all(axis=1)
            chosen = int(np.argmax(free)) if free.any() else chosen
        else:
            chosen = 0
        turn = float(outlook.predictor.turn_time_s(back)[chosen])
        height = abs(states[chosen].down_m - level) if not math.isnan(level) else 0.0
        climb = height / settings.climb_mps + (2.0 * settings.level_off_s if height > 1.0 else 0.0)
        escape = float(times[starts[chosen]])
        return escape, escape + max(turn, climb)


class _Round:
    """One round of the resolver: what each UAV flies, updated as the round goes on."""

    def __init__(self, resolver: GeometricResolver, situation: Situation) -> None:
        self._r = resolver
        self._s = situation
        self._by_id = {a.id: a for a in situation.aircraft}
        ids = list(self._by_id)
        states = [self._by_id[i].state for i in ids]
        self._aims = {i: aim_of(self._by_id[i].guidance, self._by_id[i].escape) for i in ids}
        flown = resolver.positions(states, [self._aims[i] for i in ids])
        free = resolver.positions(states, [self._by_id[i].guidance for i in ids])
        self._flown = dict(zip(ids, flown, strict=True))
        self._free = dict(zip(ids, free, strict=True))
        self._settled = {i for i in ids if i not in situation.members}
        self._settled.add(situation.computing)

    def advise(self) -> list[Advice]:
        """Everybody's advice, in ID order; the computing UAV's own last."""
        own = self._s.computing
        advice = []
        for target in self._s.members:
            if target != own and target in self._by_id:
                advice.append(self._one(target))
                self._settled.add(target)
        stuck = [a.target for a in advice if a is not None and a.stage == "least_bad"]
        if own in self._by_id and (stuck or self._by_id[own].escape):
            self._settled.discard(own)
            mine = self._one(own, may_start=bool(stuck))
            if mine and mine.stage not in ("keep", "clear", "least_bad"):
                mine = replace(mine, stage="own")
                again = {target: self._one(target) for target in stuck}
                advice = [again.get(a.target, a) if a else None for a in advice]
            advice.append(mine)
        return [a for a in advice if a is not None]

    def _one(self, target: int, may_start: bool = True) -> Advice | None:
        """Advice for one UAV: nothing, keep, resume, or a manoeuvre; updates what it flies."""
        craft = self._by_id[target]
        others = self._others(target, self._flown)
        free, flown = self._free[target], self._flown[target]
        if craft.escape is None:
            first = self._r.first_alert_s(free, others)
            if math.isinf(first) or not may_start:
                return None
        else:
            first = self._first(free, others)
            if math.isinf(first):
                self._fly(target, craft.guidance, free)
                return Advice(target, "resume", stage="clear")
            if math.isinf(self._r.first_alert_s(flown, others)):
                return Advice(target, "keep", stage="keep")
        angle = self._collision_angle(target, first)
        sector = sector_of(angle)
        choice = self._choose(craft, sector, others)
        self._fly(target, choice.aim, choice.positions)
        rest = [(self._by_id[i].state, self._aims[i]) for i in self._near(target)]
        escape_s, intercept_s = self._r.escape_times_s(craft, choice.aim, rest)
        return Advice(
            target,
            choice.option.manoeuvre,
            choice.aim.heading_rad,
            choice.option.turn_rad,
            choice.option.climb_mps,
            sector,
            angle,
            first,
            choice.stage,
            choice.least_separation,
            choice.safe_options,
            escape_s,
            intercept_s,
        )

    def _choose(self, craft: Aircraft, sector: str, others: Array) -> Choice:
        axis = "turn" if sector in ("head_on", "rear") else "climb"
        families = self._r.families(axis, abs(craft.guidance.climb_mps) > LEVEL_MPS)
        before = self._others(craft.id, {i: self._flown[i] for i in self._settled})
        tried: list[tuple[list[Option], Array]] = []
        for stage, options in families:
            paths = self._paths(craft, options)
            tried.append((options, paths))
            found = self._cheapest(craft, sector, options, paths, others)
            if found is not None:
                return self._choice(craft, options, paths, *found, stage, others)
        if len(before) < len(others):
            for options, paths in tried:
                found = self._cheapest(craft, sector, options, paths, before)
                if found is not None:
                    return self._choice(craft, options, paths, *found, "priority", others)
        options = [o for family, _ in tried for o in family]
        paths = np.concatenate([p for _, p in tried])
        ranks = self._r.ranks(paths, others) - 1e-3 * self._dislike(craft, sector, options)
        ranks[~self._r.above_ground(paths)] = -1.0
        best = int(np.argmax(ranks))
        stage = "tight" if self._r.clear(paths[best], others) else "least_bad"
        return self._choice(craft, options, paths, best, 0, stage, others)

    def _cheapest(
        self, craft: Aircraft, sector: str, options: list[Option], paths: Array, others: Array
    ) -> tuple[int, int] | None:
        """Index of the cheapest safe option and how many are safe (eq. 10, 11); None if none is."""
        safe = self._r.above_ground(paths)
        if len(others):
            safe &= np.isinf(self._r.overlaps(paths, others)).all(axis=1)
        if not safe.any():
            return None
        cost = np.where(safe, self._dislike(craft, sector, options), np.inf)
        return int(np.argmin(cost)), int(safe.sum())

    def _dislike(self, craft: Aircraft, sector: str, options: list[Option]) -> Array:
        """Cost of each option: |tc|, |Hc - cc|; a reversal of sense is dearer; ties by design."""
        up, wanted = sector == "left", craft.guidance.climb_mps
        cost = np.array([abs(o.turn_rad) for o in options]) / self._r.widest_rad
        cost += [
            0.0 if o.manoeuvre == "turn" else abs(wanted - o.climb_mps) / self._r.steepest_mps
            for o in options
        ]
        cost += [1e-6 * (o.turn_rad < 0.0) for o in options]
        cost += [2e-6 * ((o.climb_mps > 0.0) != up) for o in options]
        if craft.escape is not None:
            cost += [10.0 * _reverses(craft, o) for o in options]
        return cost

    def _choice(
        self,
        craft: Aircraft,
        options: list[Option],
        paths: Array,
        index: int,
        safe: int,
        stage: str,
        others: Array,
    ) -> Choice:
        least = float(self._r.least_separation(paths[index : index + 1], others)[0])
        option = options[index]
        return Choice(option, stage, paths[index], self._aim(craft, option), least, safe)

    def _aim(self, craft: Aircraft, option: Option) -> Aim:
        heading = wrap_angle(craft.guidance.heading_rad + option.turn_rad)
        return aim_of(craft.guidance, Escape(option.manoeuvre, heading, option.climb_mps))

    def _paths(self, craft: Aircraft, options: list[Option]) -> Array:
        aims = [self._aim(craft, o) for o in options]
        return self._r.positions([craft.state] * len(aims), aims)

    def _fly(self, target: int, aim: Aim, positions: Array) -> None:
        self._aims[target] = aim
        self._flown[target] = positions

    def _near(self, target: int) -> list[int]:
        """The others that the target could meet within 2 T_s."""
        here = self._by_id[target].state
        horizon = self._r._outlook.horizon_s
        out = []
        for other, craft in self._by_id.items():
            s = craft.state
            reach = (s.speed_mps + here.speed_mps) * horizon + self._r._required.horizontal_m
            apart = math.hypot(s.north_m - here.north_m, s.east_m - here.east_m)
            if other != target and apart < reach:
                out.append(other)
        return out

    def _others(self, target: int, paths: dict[int, Array]) -> Array:
        rows = [paths[i] for i in self._near(target) if i in paths]
        empty = np.empty((0, *self._flown[target].shape))
        return np.stack(rows) if rows else empty

    def _first(self, path: Array, others: Array) -> float:
        if not len(others):
            return math.inf
        return float(self._r.overlaps(path[None], others).min())

    def _collision_angle(self, target: int, first_s: float) -> float:
        """Bearing of the target at its first overlap, relative to the computing UAV's heading."""
        own = self._s.computing
        if own == target:
            return 0.0
        times = self._r._outlook.times_s
        mine, its = (
            [float(np.interp(first_s, times, path[:, axis])) for axis in (0, 1)]
            for path in (self._flown[own], self._free[target])
        )
        bearing = math.atan2(its[1] - mine[1], its[0] - mine[0])
        return wrap_angle(bearing - self._by_id[own].state.heading_rad)


def _reverses(craft: Aircraft, option: Option) -> bool:
    """Whether an option turns or climbs to the other side than the escape being flown."""
    assert craft.escape is not None
    e = craft.escape
    if option.climb_mps * e.climb_mps < 0.0 and e.manoeuvre != "turn":
        return True
    side = wrap_angle(e.heading_rad - craft.guidance.heading_rad)
    return e.manoeuvre != "climb" and option.turn_rad * side < 0.0
