"""The lines of a decision: an advisory as it is logged, with the candidates it was chosen from.

What a resolver does not tell is left out of the payload.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from fleet.protocol.bounds import (
    Airspeed,
    Angle,
    Coordinate,
    Cost,
    Count,
    Name,
    Seconds,
    SeparationValue,
    Speed,
)

MOST_CANDIDATES = 512
"""So many candidates of an advisory are logged, and no more are taken from a log."""


class LoggedCandidate(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, gc=False
):
    """A manoeuvre that a resolver looked at, and what it found of it; one of them is `chosen`.

    `first_overlap_s` is left out where zones do not overlap, too.
    """

    manoeuvre: Name
    turn_rad: Angle
    climb_mps: Speed
    level_down_m: Coordinate | None = None
    speed_mps: Airspeed | None = None
    safe: bool = False
    chosen: bool = False
    first_overlap_s: Seconds | None = None
    least_separation: SeparationValue | None = None
    cost: Cost | None = None


class LoggedAdvisory(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, gc=False):
    """What a UAV in conflict is told, and why."""

    target: Count
    sector: Name
    collision_angle_rad: Angle
    time_to_violation_s: Seconds
    stage: Name
    manoeuvre: Name
    turn_rad: Angle
    climb_mps: Speed
    least_separation: SeparationValue
    manoeuvre_s: Seconds
    intercept_s: Seconds
    level_down_m: Coordinate | None = None
    speed_mps: Airspeed | None = None
    unresolved: bool = False
    candidates: Annotated[tuple[LoggedCandidate, ...], Meta(max_length=MOST_CANDIDATES)] = ()
