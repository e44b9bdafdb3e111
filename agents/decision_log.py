"""How an advisory is logged: as a line of a decision, with the candidates it was chosen from."""

from __future__ import annotations

import math

from fleet.agents.advisory import Advisory, Aircraft, Candidate
from fleet.model.units import wrap_angle
from fleet.model.words import TURNING
from fleet.protocol.advisories import MOST_CANDIDATES, LoggedAdvisory, LoggedCandidate
from fleet.protocol.surveillance import told_speed

SAME_RAD = 1e-9
"""Turns nearer to each other are the same, but for rounding."""


def turn_of(advisory: Advisory, craft: Aircraft | None) -> float:
    """By how much a UAV is told to turn from guidance's heading, in rad; 0 if it is not."""
    if not math.isnan(advisory.turn_rad):
        return advisory.turn_rad
    if advisory.manoeuvre not in TURNING or craft is None:
        return 0.0
    return wrap_angle(advisory.heading_rad - craft.guidance.heading_rad)


def logged(advisory: Advisory, craft: Aircraft | None) -> LoggedAdvisory:
    """The line of a decision that tells an advisory, for a UAV that may be known."""
    turn_rad = turn_of(advisory, craft)
    candidates = [_logged_candidate(c, advisory, turn_rad) for c in advisory.candidates]
    if len(candidates) > MOST_CANDIDATES:
        candidates.sort(key=lambda c: not c.chosen)
    return LoggedAdvisory(
        advisory.target,
        advisory.sector,
        advisory.collision_angle_rad,
        advisory.time_to_violation_s,
        advisory.stage,
        advisory.manoeuvre,
        turn_rad,
        advisory.climb_mps,
        advisory.least_separation,
        advisory.manoeuvre_s,
        advisory.intercept_s,
        _finite(advisory.level_down_m),
        told_speed(advisory.speed_mps),
        advisory.unresolved,
        tuple(candidates[:MOST_CANDIDATES]),
    )


def _logged_candidate(candidate: Candidate, advisory: Advisory, turn_rad: float) -> LoggedCandidate:
    return LoggedCandidate(
        candidate.manoeuvre,
        candidate.turn_rad,
        candidate.climb_mps,
        _finite(candidate.level_down_m),
        told_speed(candidate.speed_mps),
        candidate.safe,
        _is_chosen(candidate, advisory, turn_rad),
        _finite(candidate.first_overlap_s),
        _finite(candidate.least_separation),
        _finite(candidate.cost),
    )


def _is_chosen(candidate: Candidate, advisory: Advisory, turn_rad: float) -> bool:
    """Whether a candidate is what the advisory says."""
    return (
        candidate.manoeuvre == advisory.manoeuvre
        and abs(wrap_angle(candidate.turn_rad - turn_rad)) < SAME_RAD
        and candidate.climb_mps == advisory.climb_mps
        and _finite(candidate.level_down_m) == _finite(advisory.level_down_m)
        and _finite(candidate.speed_mps) == _finite(advisory.speed_mps)
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
