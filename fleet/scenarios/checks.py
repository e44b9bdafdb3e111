"""What types cannot say: values of a scenario that do not fit each other."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator

from fleet.model.faults.burst import Burst
from fleet.model.faults.navigation import Navigation
from fleet.model.faults.process import Kill
from fleet.model.faults.range import MODELS, Range
from fleet.model.faults.rules import COORDINATOR, names
from fleet.model.generate import TooDenseError, uavs_of
from fleet.model.scenario import Crossing, Scenario
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
    yield from _faults(s)


def _who_flies(s: Scenario) -> Iterator[str]:
    if s.uav and s.generate:
        yield "uav, generate: both are given; keep one of them"
    if not s.uav and not s.generate:
        yield "uav: nobody flies; add [[uav]] tables or a [generate] table"
    repeated = [str(i) for i, n in Counter(u.id for u in s.uav).items() if n > 1]
    if repeated:
        yield f"uav: ID {', '.join(repeated)} is used more than once; give every UAV its own id"
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
    if r.horizon_s / r.sample_s > MAX_SAMPLES:
        yield f"resolution.sample_s: more than {MAX_SAMPLES} samples in horizon_s; make it larger"


def _options(s: Scenario) -> Iterator[str]:
    for key, value in (
        ("turn_options", s.resolution.turn_options),
        ("climb_options", s.resolution.climb_options),
    ):
        if value % 2 == 0:
            yield f"resolution.{key}: {value} is even; use an odd number, so that 0 is among them"


def _flyable(s: Scenario) -> Iterator[str]:
    slope = math.sin(math.radians(s.performance.max_flight_path_deg))
    speeds = {f"uav.{u.id}": u.speed_mps for u in s.uav}
    if s.generate:
        speeds["generate"] = s.generate.speed_mps
    for who, speed in speeds.items():
        for key, climb in (
            ("resolution.max_climb_mps", s.resolution.max_climb_mps),
            ("resolution.max_dive_mps", s.resolution.max_dive_mps),
            ("guidance.climb_mps", s.guidance.climb_mps),
        ):
            if climb > speed * slope:
                yield (
                    f"{key}: {climb:g} m/s is more than {who} can fly at {speed:g} m/s within "
                    f"performance.max_flight_path_deg; at most {speed * slope:.3g}"
                )
        pull = speed * math.radians(s.performance.max_flight_path_rate_degps)
        if s.guidance.climb_mps / s.guidance.level_off_s > pull:
            yield (
                "guidance.level_off_s: too short to level off from climb_mps within "
                "performance.max_flight_path_rate_degps; at least "
                f"{s.guidance.climb_mps / pull:.2g}"
            )
    points = [p for u in uavs_of(s) for p in (u.position_ned_m, *u.waypoints_ned_m)]
    farthest = max(math.hypot(*p) for p in points)
    if farthest + max(speeds.values()) * s.duration_s > MAX_DISTANCE_M:
        yield (
            f"duration_s: UAVs could come further than {MAX_DISTANCE_M:g} m from the origin; make "
            "it shorter, or their positions and waypoints nearer"
        )
    radii = [s.limits().turn_radius_m(v) for v in speeds.values()]
    if radii and s.guidance.arrival_radius_m < 0.1 * max(radii):
        yield (
            "guidance.arrival_radius_m: under a tenth of the turning radius "
            f"({max(radii):.0f} m); waypoints could be circled for ever, make it larger"
        )
    starts = Counter(u.position_ned_m for u in s.uav)
    if any(n > 1 for n in starts.values()):
        yield "uav: two UAVs start at the same position_ned_m; move one"


def _faults(s: Scenario) -> Iterator[str]:
    flying = [u.id for u in uavs_of(s)] if s.fault else []
    for n, rule in enumerate(s.fault):
        if rule.end_s is not None and rule.end_s < rule.start_s:
            yield f"fault[{n}].end_s: before start_s; make it later"
        if isinstance(rule, Kill) and rule.then == "vanish" and rule.end_s is not None:
            yield f"fault[{n}].end_s: what has vanished cannot start again; remove it"
        others = [] if isinstance(rule, Navigation) else [COORDINATOR]
        for key in ("node", "src", "dst", "groups"):
            for part in re.split("[,/]", getattr(rule, key, "*")):
                if not any(names(part, number) for number in flying + others):
                    yield (
                        f"fault[{n}].{key}: '{part}' names nobody whom it could concern; "
                        f"the UAVs are {min(flying)} to {max(flying)}"
                    )
        if isinstance(rule, Burst) and rule.enter > 1.0 + 1e-9:
            needed = math.ceil(rule.loss / (1.0 - rule.loss) - 1e-9)
            yield (
                f"fault[{n}].mean_ticks: bursts so short cannot make up a mean loss of "
                f"{rule.loss:g}; make it {needed} or more"
            )
        if isinstance(rule, Range):
            yield from _range(f"fault[{n}]", rule)


def _range(key: str, rule: Range) -> Iterator[str]:
    """Keys that the model of a range rule needs, and such as it does not have."""
    if rule.model == "cutoff" and rule.max_m is None:
        yield f"{key}.max_m: missing; add it, since model 'cutoff' goes by it"
    if rule.model == "polynomial" and not (rule.quadratic_per_m2 or rule.linear_per_m):
        yield f"{key}.quadratic_per_m2: missing, and so is linear_per_m; add one of them"
    defaults = Range()
    for model, keys in MODELS.items():
        for other in keys:
            if model != rule.model and getattr(rule, other) != getattr(defaults, other):
                yield f"{key}.{other}: model '{rule.model}' does not have it; leave it out"
