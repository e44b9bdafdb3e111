"""What types cannot say: values of a scenario that do not fit each other, or are hardly meant."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from fleet.config.fault_checks import fault_problems
from fleet.config.scenario import Crossing, Scenario
from fleet.config.traffic import uavs_of
from fleet.errors import TooDenseError
from fleet.model.elementary import hypot, sin
from fleet.model.equipment import computes
from fleet.model.units import to_ns

MAX_SAMPLES = 2000
MAX_DISTANCE_M = 9e6
"""Under the bound of a coordinate in a message."""


def problem_with(scenario: Scenario) -> str:
    """The first problem, as `key: what; remedy`; empty if there is none."""
    return next(_problems(scenario), "")


def _problems(s: Scenario) -> Iterator[str]:
    yield from _who_flies(s)
    yield from _times(s)
    yield from _options(s)
    yield from _flyable(s)
    yield from fault_problems(s)


def _who_flies(s: Scenario) -> Iterator[str]:
    if s.uav and s.generate:
        yield "uav, generate: both are given; keep one of them"
    if not s.uav and not s.generate:
        yield "uav: nobody flies; add [[uav]] tables or a [generate] table"
    repeated = [str(i) for i, n in Counter(u.id for u in s.uav).items() if n > 1]
    if repeated:
        yield f"uav: ID {', '.join(repeated)} is used more than once; give every UAV its own id"
    if s.resolution.max_altitude_m <= s.resolution.min_altitude_m:
        yield "resolution.max_altitude_m: not above min_altitude_m; raise it"
    if isinstance(s.generate, Crossing) and s.generate.max_altitude_m < s.generate.min_altitude_m:
        yield "generate.max_altitude_m: below min_altitude_m; raise it"
    try:
        uavs_of(s)
    except TooDenseError as error:
        yield f"generate: {error}"


def _times(s: Scenario) -> Iterator[str]:
    if s.ticks < 1:
        yield f"duration_s: shorter than one tick of {s.tick_s:g} s; make it longer"
    for key, value in (
        ("surveillance.broadcast_s", s.surveillance.broadcast_s),
        ("coordination.update_s", s.coordination.update_s),
    ):
        if to_ns(value) % s.tick_ns:
            yield f"{key}: {value:g} s is not a multiple of tick_s = {s.tick_s:g} s; make it one"
    if s.coordination.election_valid_s <= s.coordination.election_repeat_s:
        yield "coordination.election_valid_s: not longer than election_repeat_s; make it longer"
    if s.coordination.silence_limit_s <= s.surveillance.broadcast_s + s.tick_s:
        yield "coordination.silence_limit_s: not longer than broadcast_s and a tick; make it longer"
    if s.commands.valid_s <= s.commands.lead_s + s.tick_s:
        yield "commands.valid_s: not longer than lead_s and a tick; make it longer"
    if s.surveillance.timeout_s <= s.surveillance.broadcast_s:
        yield "surveillance.timeout_s: not longer than broadcast_s; make it longer"
    r = s.resolution
    for key in ("horizon_s", "climb_horizon_s"):
        if getattr(r, key) / r.sample_s > MAX_SAMPLES:
            yield f"resolution.sample_s: more than {MAX_SAMPLES} samples in {key}; make it larger"


def _options(s: Scenario) -> Iterator[str]:
    for key, value in (
        ("turn_candidates", s.resolution.turn_candidates),
        ("climb_candidates", s.resolution.climb_candidates),
        ("speed_candidates", s.resolution.speed_candidates),
    ):
        if value % 2 == 0 and value:
            yield f"resolution.{key}: {value} is even; use an odd number, so that 0 is among them"
    if s.resolution.rear_deg < s.resolution.head_on_deg:
        yield "resolution.rear_deg: less than head_on_deg; raise it"


def _flyable(s: Scenario) -> Iterator[str]:
    flown = [(f"uav.{u.id}", u.id, u.speed_mps) for u in s.uav]
    if s.generate:
        flown.append(("generate", 0, s.generate.speed_mps))
    for who, uav, speed in flown:
        yield from (f"{who}: {problem}" for problem in s.performance_of(uav).validate(speed))
        yield from _climbs(s, who, uav, speed)
    points = [p for u in uavs_of(s) for p in (u.position_ned_m, *u.waypoints_ned_m)]
    farthest = max(hypot(*p) for p in points)
    beyond = max(2.0 * s.pilot(u, v).spacing_m + v * s.duration_s for _, u, v in flown)
    if farthest + beyond > MAX_DISTANCE_M:
        yield (
            f"duration_s: UAVs could come further than {MAX_DISTANCE_M:g} m from the origin; make "
            "it shorter, or their positions and waypoints nearer"
        )
    radii = [s.model(u).limits.turn_radius_m(v) for _, u, v in flown]
    if s.guidance.arrival_radius_m < 0.1 * max(radii):
        yield (
            "guidance.arrival_radius_m: under a tenth of the turning radius "
            f"({max(radii):.0f} m); waypoints could be circled for ever, make it larger"
        )
    starts = Counter(u.position_ned_m for u in s.uav)
    if any(n > 1 for n in starts.values()):
        yield "uav: two UAVs start at the same position_ned_m; move one"


def _climbs(s: Scenario, who: str, uav: int, speed: float) -> Iterator[str]:
    """Of one UAV: climbs that are too steep for it, and too short a time for levelling off."""
    limits, guidance = s.model(uav).limits, s.pilot(uav, speed).settings
    steepest = speed * sin(limits.steepest_rad(speed))
    own = next((u for u in s.uav if u.id == uav), None)
    where = f"{who}.guidance_climb_mps" if own and own.guidance_climb_mps else "guidance.climb_mps"
    for key, climb in (
        ("resolution.max_climb_mps", s.resolution.max_climb_mps),
        ("resolution.max_dive_mps", s.resolution.max_dive_mps),
        (where, guidance.climb_mps),
        (f"{who}.climb_mps", abs(own.climb_mps) if own else 0.0),
    ):
        if climb > steepest:
            yield (
                f"{key}: {climb:g} m/s is more than {who} can fly at {speed:g} m/s, by its "
                f"performance; at most {steepest:.3g}"
            )
    pull = speed * limits.pitch_rate_radps(speed)
    if guidance.climb_mps / s.guidance.level_off_s > pull:
        yield (
            f"guidance.level_off_s: too short for {who} to level off from {where}, by its "
            f"performance; at least {guidance.climb_mps / pull:.2g}"
        )


def leaderless(s: Scenario) -> str:
    """Why nobody can lead any group, if that is so and there is somebody to be led."""
    flying = uavs_of(s)
    if len(flying) < 2 or any(computes(u.equipment) for u in flying):
        return ""
    return (
        "no UAV can both compute and hear (uav.equipment is 'full' nowhere): nobody is elected, "
        "nobody is commanded, and separation is what chance makes of it"
    )
