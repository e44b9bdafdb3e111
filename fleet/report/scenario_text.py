"""The scenario of a run in words, and as the TOML file that repeats it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import tomli_w

from fleet.config.scenario import Resolution, Scenario, Zone
from fleet.log.run_metadata import RunMetadata
from fleet.report.run_data import RunData

FactRow = tuple[str, str]


def facts(run_data: RunData) -> list[FactRow]:
    """What was flown, where and with what: names and values with units."""
    s = run_data.scenario
    r = s.resolution
    speeds = sorted({f.uav.speed_mps for f in run_data.flights})
    rows = [
        ("Scenario", f"{s.name}: {s.description}" if s.description else s.name),
        ("UAVs", f"{len(run_data.flights)}, at {_range(speeds)} m/s"),
        ("Duration", f"{s.duration_s:g} s in ticks of {s.tick_s:g} s"),
        ("Protected zone", _zones(s, [f.uav.id for f in run_data.flights])),
        ("Required separation", _required(s)),
        ("Time segment T_s", f"{r.horizon_s:g} s, margin {r.margin:.0%}{_of_climbs(r)}"),
        ("Resolver", s.resolver),
        *_candidates(s),
        ("Electors", s.coordination.electors),
        ("Broadcast every", f"{s.surveillance.broadcast_s:g} s"),
        ("Seed", str(s.seed)),
    ]
    return rows + _run_rows(run_data.about)


def _zones(s: Scenario, uavs: Sequence[int]) -> str:
    """The zone of most UAVs, and those of the others."""
    own = [uav for uav in uavs if s.zone_of(uav) != s.zone]
    texts = [_zone(s.zone)] if len(own) < len(uavs) else []
    return "; ".join([*texts, *(f"UAV {uav}: {_zone(s.zone_of(uav))}" for uav in own)])


def _zone(zone: Zone) -> str:
    return f"radius {zone.radius_m:g} m, half height {zone.half_height_m:g} m"


def _required(s: Scenario) -> str:
    required = s.required()
    text = f"{required.horizontal_m:g} m horizontally or {required.vertical_m:g} m vertically"
    if s.zone_ratios().larger:
        return f"{text} of two UAVs with the least zones, else the sums of both"
    return text


def _candidates(s: Scenario) -> list[tuple[str, str]]:
    """What the resolver `geometric` may choose from; another one has its own."""
    if s.resolver != "geometric":
        return []
    r = s.resolution
    words = (
        f"{r.turn_candidates} turns to \N{PLUS-MINUS SIGN}{r.max_turn_deg:g}°, "
        f"{r.climb_candidates} climbs from -{r.max_dive_mps:g} to +{r.max_climb_mps:g} m/s"
        f"{_speeds(s)}"
    )
    return [("Candidates", words)]


def _of_climbs(rules: Resolution) -> str:
    return f"; of climbs T_H {rules.climb_horizon_s:g} s" if rules.climb_horizon_s else ""


def _speeds(scenario: Scenario) -> str:
    p, count = scenario.performance, scenario.resolution.speed_candidates
    between = f"{p.min_speed_share:.0%} to {p.max_speed_share:.0%} of cruise"
    return f", {count} speeds of {between}" if count else ""


def _run_rows(about: RunMetadata) -> list[FactRow]:
    rows = [
        ("Run", about.run),
        ("Clock and bus", f"{about.clock or '?'}, {about.bus or '?'}"),
        ("Changed with --set", ", ".join(about.overrides) or "nothing"),
        ("Version", f"fleet {about.fleet_version or '?'}, Python {about.python or '?'}"),
        ("Packages", ", ".join(f"{name} {version}" for name, version in about.versions.items())),
        ("Machine", about.machine),
        ("Status", about.status or "unknown"),
        ("Digest", about.digest or ""),
    ]
    return [(name, value) for name, value in rows if value]


def _range(values: list[float]) -> str:
    if not values:
        return "?"
    return f"{values[0]:g}" if values[0] == values[-1] else f"{values[0]:g} to {values[-1]:g}"


def effective_toml(run_data: RunData) -> str:
    """The scenario as it was flown, with the fault plan at the end: flown again, it is the same."""
    scenario = msgspec.structs.replace(run_data.scenario, fault=run_data.plan)
    table: dict[str, Any] = _without_nothing(msgspec.to_builtins(scenario))
    return tomli_w.dumps(table)


def _without_nothing(value: Any) -> Any:
    """TOML has no null; empty lists would hide that another table says who flies."""
    if isinstance(value, dict):
        kept = {k: _without_nothing(v) for k, v in value.items() if v is not None}
        return {k: v for k, v in kept.items() if v != []}
    if isinstance(value, list | tuple):
        return [_without_nothing(v) for v in value]
    return value


def repeat_command(run_data: RunData) -> str:
    """What to type, once the TOML is saved under its name."""
    clock = " --clock realtime" if run_data.about.realtime else ""
    return f"fleet run {run_data.scenario.name}.toml{clock} --out again.mcap"
