"""What the geometric resolver chooses among: members of the command sets (eq. 7), in families.

And what each of them costs (eq. 10 and 11).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fleet.agents.advisory import Aircraft, Candidate
from fleet.config.scenario import Scenario
from fleet.model.conflict.command_set import (
    Altitudes,
    climb_commands,
    command_set,
    speed_commands,
    turn_commands,
)
from fleet.model.types import Array
from fleet.model.units import wrap_angle
from fleet.model.words import Manoeuvre


class Stage(StrEnum):
    """How the geometric resolver found an advisory.

    On the axis that the sector gives, by a speed, on the other axis or on both; clear of those
    alone who were resolved before (priority); clear, but not safe (tight); the least bad; or with a
    manoeuvre of the computing UAV (own). A manoeuvre that is flown is kept, or ended (clear).
    """

    AXIS = "axis"
    SPEED = "speed"
    OTHER = "other"
    BOTH = "both"
    PRIORITY = "priority"
    TIGHT = "tight"
    LEAST_BAD = "least_bad"
    OWN = "own"
    KEEP = "keep"
    CLEAR = "clear"


LEVELS_EACH_SIDE = 2
"""So many safe altitudes above, and below, are tried."""


class CandidateSets:
    """All candidates that the scenario allows."""

    def __init__(self, scenario: Scenario) -> None:
        rules = scenario.resolution
        self.rules = rules
        self._scenario = scenario
        self.widest_rad = math.radians(rules.max_turn_deg)
        self.steepest_mps = max(rules.max_climb_mps, rules.max_dive_mps)
        turns = turn_commands(self.widest_rad, rules.turn_candidates)
        climbs = climb_commands(rules.max_dive_mps, rules.max_climb_mps, rules.climb_candidates)
        family = command_set(turns, climbs)
        self._turns = [Candidate(Manoeuvre.TURN, tc, 0.0) for tc, _ in family if tc]
        self._climbs = [cc for _, cc in family if cc]

    def families(
        self, axis: str, levels: Levels, craft: Aircraft, *, climbing: bool
    ) -> list[tuple[Stage, list[Candidate]]]:
        """The families of candidates in the order in which they are tried.

        Level flight is a manoeuvre only for a UAV whose guidance climbs or dives.
        """
        turns = self._turns
        climbs = [
            Candidate(Manoeuvre.CLIMB, 0.0, cc, z) for cc in self._climbs for z in levels.near(cc)
        ]
        if climbing:
            climbs.append(Candidate(Manoeuvre.CLIMB, 0.0, 0.0))
        both = [
            Candidate(Manoeuvre.TURN_CLIMB, t.turn_rad, cc, levels.beyond(cc))
            for t in turns
            for cc in self._climbs
        ]
        first, second = (turns, climbs) if axis == Manoeuvre.TURN else (climbs, turns)
        families = [(Stage.AXIS, first), (Stage.OTHER, second), (Stage.BOTH, both)]
        speeds = self._speeds(craft)
        if speeds:
            families.insert(2, (Stage.SPEED, speeds))
        return families

    def fastest_mps(self, uav: int, cruise_mps: float) -> float:
        """The greatest speed that a UAV may be commanded to fly that cruises at this."""
        if not self.rules.speed_candidates:
            return cruise_mps
        return self._scenario.speeds_mps(uav, cruise_mps)[1]

    def costs(self, craft: Aircraft, sector: str, candidates: Sequence[Candidate]) -> Array:
        """Cost of each candidate, shape (m,): k1 |tc|, k2 |Hc - cc|; a reversal of sense is dearer.

        Each is relative to the greatest there is. Ties by design.
        """
        up, wanted = sector == "left", craft.guidance.climb_mps
        k1, k2 = self.rules.turn_cost, self.rules.climb_cost
        cost = k1 * np.array([abs(c.turn_rad) for c in candidates]) / self.widest_rad
        kept = (Manoeuvre.TURN, Manoeuvre.SPEED)
        climbs = [0.0 if c.manoeuvre in kept else abs(wanted - c.climb_mps) for c in candidates]
        cost += k2 * np.array(climbs) / self.steepest_mps
        cruise = craft.cruise_mps
        cost += [
            abs(c.speed_mps / cruise - 1.0) if c.manoeuvre == Manoeuvre.SPEED else 0.0
            for c in candidates
        ]
        here = craft.state.down_m
        cost += [
            0.0 if c.climb_mps == 0.0 else 1e-9 * abs(c.level_down_m - here) for c in candidates
        ]
        cost += [1e-6 * (c.turn_rad < 0.0 or c.speed_mps > cruise) for c in candidates]
        cost += [2e-6 * ((c.climb_mps > 0.0) != up) for c in candidates]
        if craft.manoeuvre is not None:
            cost += [10.0 * reverses(craft, c) for c in candidates]
        return cost

    def _speeds(self, craft: Aircraft) -> list[Candidate]:
        cruise_mps, count = craft.cruise_mps, self.rules.speed_candidates
        bounds = self._scenario.speeds_mps(craft.id, cruise_mps)
        speeds = speed_commands(bounds, cruise_mps, count)
        return [
            Candidate(Manoeuvre.SPEED, 0.0, 0.0, speed_mps=v) for v in speeds if v != cruise_mps
        ]


@dataclass(frozen=True, slots=True)
class Levels:
    """Where a UAV at `start_down_m` may level off, clear of those in its way.

    `up` and `down` are the next safe altitudes above and below it, the nearest first, each at most
    `EDGES`; `level_off_s` is the time constant of levelling off.
    """

    start_down_m: float
    up: tuple[float, ...]
    down: tuple[float, ...]
    level_off_s: float
    altitudes: Altitudes

    def near(self, climb_mps: float) -> list[float]:
        """For one climb: the safe altitudes, and that which is passed before it levels off."""
        edges = self.up if climb_mps > 0.0 else self.down
        out = {self._within(climb_mps, edge) for edge in edges}
        return sorted(out | {self.beyond(climb_mps)}, key=lambda z: abs(z - self.start_down_m))

    def beyond(self, climb_mps: float) -> float:
        """So far that the first safe altitude is passed before levelling off begins.

        Where there is nobody to clear on that side, the climb levels off at once.
        """
        edges = self.up if climb_mps > 0.0 else self.down
        edge = edges[0] if edges else self.start_down_m
        return self._within(climb_mps, edge - climb_mps * self.level_off_s)

    def _within(self, climb_mps: float, level_down_m: float) -> float:
        return self.altitudes.level_m(climb_mps, level_down_m, self.start_down_m)


def reverses(craft: Aircraft, candidate: Candidate) -> bool:
    """Whether a candidate turns, climbs or changes speed the other way than the manoeuvre flown."""
    assert craft.manoeuvre is not None
    e, cruise = craft.manoeuvre, craft.cruise_mps
    if Manoeuvre.SPEED in (e.manoeuvre, candidate.manoeuvre):
        return (candidate.speed_mps - cruise) * (e.speed_mps - cruise) < 0.0
    if candidate.climb_mps * e.climb_mps < 0.0 and e.manoeuvre != Manoeuvre.TURN:
        return True
    side = wrap_angle(e.heading_rad - craft.guidance.heading_rad)
    return e.manoeuvre != Manoeuvre.CLIMB and candidate.turn_rad * side < 0.0
