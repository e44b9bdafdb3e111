"""The scenario of imported traffic: who can fly in it, and settings that suit all who do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import tomli_w

from fleet.config.loading import MAX_BYTES, convert
from fleet.config.scenario import Origin, Point, Scenario
from fleet.errors import ScenarioError
from fleet.imports.imported import SLOWEST_MPS, ForeignTraffic, ImportedUav, ImportRemark
from fleet.model.units import GRAVITY_MPS2
from fleet.model.vehicle.models.point_mass import PointMassPerformance
from fleet.printing import printable

FASTEST_MPS = 500.0
IMPORT_REACH_M = 1e6
LARGEST_FLEET = 1000
MOST_WAYPOINTS = 1000
"""Bounds of scenarios."""

STEEPEST_DEG = 59.0
CLIMB_SPARE = 1.05
"""What a UAV must be able to climb, over what it does."""

CEILING_M = 6000.0
ABOVE_M = 1000.0
"""Manoeuvres go so far above the highest aircraft."""

RUN_ON_S = 60.0
"""A run goes on for so long after the encounter, or T_s if that is longer."""

REMARKS_NAMED = 3


@dataclass(frozen=True, slots=True)
class ImportedTraffic:
    """What `import_traffic` makes of a file.

    `uavs` are those that were taken over, of which `scenario.uav` has the tables in the same order:
    the first is UAV 1. `remarks` say what could not be taken over, in the order of the file. `toml`
    is the scenario as the text of a file, in which remarks, and which UAV is which, are comments.
    """

    source: str
    program: str
    scenario: Scenario
    uavs: tuple[ImportedUav, ...]
    remarks: tuple[ImportRemark, ...]
    toml: str

    @property
    def origin(self) -> Origin:
        """Where on Earth NED 0, 0, 0 is."""
        return self.scenario.origin

    def lines(self) -> list[str]:
        """The remarks as they are told."""
        return [printable(remark.text(self.source)) for remark in self.remarks]

    def __repr__(self) -> str:
        """As `<import of head_on.daa: 2 UAVs, 1 remark>`."""
        return (
            f"<import of {self.source}: {len(self.uavs)} UAVs, {len(self.remarks)} "
            f"{'remark' if len(self.remarks) == 1 else 'remarks'}>"
        )


def imported_traffic(
    traffic: ForeignTraffic, source: str, name: str, duration_s: float | None = None
) -> ImportedTraffic:
    """The scenario of the traffic; who cannot fly in it is left out, with a remark.

    Raises:
        ScenarioError: nobody is left, there are too many, or together they make no scenario.

    """
    uavs = [uav for uav in _apart(traffic) if _can_fly(uav, traffic)]
    fleet = PointMassPerformance(max_bank_deg=traffic.settings.max_bank_deg)
    reached_m = _arrival_radius_m(uavs, fleet, traffic.corner_m)
    for uav in uavs:
        _tell_corners(uav, reached_m, traffic)
    remarks = tuple(sorted(traffic.remarks, key=lambda remark: (not remark.line, remark.line)))
    if not uavs:
        told = "; ".join(
            r.text(source).removeprefix(f"{source}: ") for r in remarks[:REMARKS_NAMED]
        )
        raise ScenarioError(
            f"{source}: no aircraft can be taken over{f': {told}' if told else ''}; "
            "a file with one that flies is needed"
        )
    if len(uavs) > LARGEST_FLEET:
        raise ScenarioError(
            f"{source}: {len(uavs)} aircraft, and a scenario has at most {LARGEST_FLEET}; choose "
            "some with --only NAME"
        )
    if len(uavs) == 1:
        remarks += (ImportRemark(0, uavs[0].name, "the only aircraft; there is nobody to avoid"),)
    table = _table(traffic, uavs, source, name, duration_s)
    scenario = convert(table, source)
    named = [f"UAV {n} is {uav.name}" for n, uav in enumerate(uavs, 1)]
    head = [f"Imported from {source} ({traffic.program}).", *named]
    head += [remark.text(source) for remark in remarks]
    comments = "".join(f"# {printable(line)}\n" for line in head)
    toml = f"{comments}\n{tomli_w.dumps(table)}"
    if len(toml.encode()) > MAX_BYTES:
        raise ScenarioError(
            f"{source}: it makes a scenario of over {MAX_BYTES >> 20} MiB; choose aircraft with "
            "--only NAME, or widen --tolerance"
        )
    return ImportedTraffic(source, traffic.program, scenario, tuple(uavs), remarks, toml)


def _apart(traffic: ForeignTraffic) -> list[ImportedUav]:
    """All but those that begin where another one does."""
    kept: dict[Point, ImportedUav] = {}
    for uav in traffic.uavs:
        other = kept.setdefault(uav.position_ned_m, uav)
        if other is not uav:
            traffic.remark(uav.line, uav.name, f"begins at the place of {other.name}; left out")
    return list(kept.values())


def _can_fly(uav: ImportedUav, traffic: ForeignTraffic) -> bool:
    why = _why_not(uav)
    if why:
        traffic.remark(uav.line, uav.name, f"{why}; left out")
    return not why


def _why_not(uav: ImportedUav) -> str:
    """Why a scenario cannot have this UAV; empty if it can."""
    if uav.speed_mps <= SLOWEST_MPS:
        standing = "stationary, at" if uav.speed_mps < 0.1 else "flies"
        return f"{standing} {uav.speed_mps:.2g} m/s, and a UAV flies more than {SLOWEST_MPS:g} m/s"
    if uav.speed_mps > FASTEST_MPS:
        return f"flies {uav.speed_mps:.0f} m/s, and a UAV at most {FASTEST_MPS:g} m/s"
    if _slope_deg(uav) > STEEPEST_DEG:
        return f"climbs at {_slope_deg(uav):.0f} degrees, and a UAV at most at {STEEPEST_DEG:g}"
    if len(uav.waypoints_ned_m) > MOST_WAYPOINTS:
        return f"needs {len(uav.waypoints_ned_m)} waypoints, and a UAV has at most {MOST_WAYPOINTS}"
    points = (uav.position_ned_m, *uav.waypoints_ned_m)
    farthest = max(abs(x) for point in points for x in point)
    if farthest > IMPORT_REACH_M:
        return f"comes {farthest / 1000.0:.0f} km from the origin, and a UAV at most 1000 km"
    return ""


def _slope_deg(uav: ImportedUav) -> float:
    climb = max(abs(uav.climb_mps), uav.guidance_climb_mps or 0.0)
    return math.degrees(math.asin(min(1.0, climb / uav.speed_mps)))


def _table(
    traffic: ForeignTraffic,
    uavs: Sequence[ImportedUav],
    source: str,
    name: str,
    duration_s: float | None,
) -> dict[str, object]:
    """The scenario as of TOML: only what is not by default."""
    settings, fleet = (
        traffic.settings,
        PointMassPerformance(max_bank_deg=traffic.settings.max_bank_deg),
    )
    after_s = max(RUN_ON_S, settings.horizon_s)
    slowest = min(uav.speed_mps for uav in uavs)
    slope = math.sin(math.radians(fleet.max_flight_path_deg))
    climb_mps = min(3.0, _rounded_down(slowest * slope))
    manoeuvre_mps = min(5.0, _rounded_down(slowest * slope))
    highest = max(-p[2] for u in uavs for p in (u.position_ned_m, *u.waypoints_ned_m))
    lowest = min(-p[2] for u in uavs for p in (u.position_ned_m, *u.waypoints_ned_m))
    table: dict[str, object] = {
        "name": name,
        "description": f"{len(uavs)} aircraft of {source}"[:200],
        "duration_s": duration_s or _whole_ten(traffic.duration_s + after_s),
        "zone": {
            "radius_m": settings.zone.radius_m,
            "half_height_m": settings.zone.half_height_m,
        },
        "performance": {"max_bank_deg": fleet.max_bank_deg},
        "guidance": {
            "climb_mps": climb_mps,
            "level_off_s": _level_off_s(uavs, fleet, climb_mps),
            "arrival_radius_m": _arrival_radius_m(uavs, fleet, traffic.corner_m),
        },
        "resolution": {
            "horizon_s": settings.horizon_s,
            "max_climb_mps": manoeuvre_mps,
            "max_dive_mps": manoeuvre_mps,
            "min_altitude_m": min(0.0, math.floor(lowest)),
            "max_altitude_m": max(CEILING_M, float(math.ceil(highest + ABOVE_M))),
        },
        "origin": {
            "latitude_deg": traffic.origin.latitude_deg,
            "longitude_deg": traffic.origin.longitude_deg,
            "altitude_m": traffic.origin.altitude_m,
        },
        "uav": [_uav_table(n, uav, fleet) for n, uav in enumerate(uavs, 1)],
    }
    return table


def _uav_table(number: int, uav: ImportedUav, fleet: PointMassPerformance) -> dict[str, object]:
    table: dict[str, object] = {
        "id": number,
        "position_ned_m": _rounded(uav.position_ned_m),
        "heading_deg": round(uav.heading_deg, 6) + 0.0,
        "waypoints_ned_m": [_rounded(point) for point in uav.waypoints_ned_m],
        "speed_mps": round(uav.speed_mps, 6),
    }
    if uav.climb_mps:
        table["climb_mps"] = round(uav.climb_mps, 6)
    if uav.guidance_climb_mps:
        table["guidance_climb_mps"] = round(uav.guidance_climb_mps, 6)
    own = dict[str, float]()
    if uav.max_bank_deg is not None and uav.max_bank_deg != fleet.max_bank_deg:
        own["max_bank_deg"] = uav.max_bank_deg
    needed = CLIMB_SPARE * _slope_deg(uav)
    if needed > fleet.max_flight_path_deg:
        own["max_flight_path_deg"] = min(STEEPEST_DEG + 0.5, math.ceil(needed))
    if own:
        table["performance"] = own
    return table


def _level_off_s(
    uavs: Sequence[ImportedUav], fleet: PointMassPerformance, climb_mps: float
) -> float:
    """Long enough for each to level off, by how fast its flight path angle changes."""
    rate = math.radians(fleet.max_flight_path_rate_degps)
    longest = max((u.guidance_climb_mps or climb_mps) / (u.speed_mps * rate) for u in uavs)
    return max(3.0, math.ceil(10.0 * CLIMB_SPARE * longest) / 10.0)


def _tell_corners(uav: ImportedUav, reached_m: float, traffic: ForeignTraffic) -> None:
    """Remark that corners are cut where they lie within two arrival radii of each other."""
    points = [uav.position_ned_m, *uav.waypoints_ned_m]
    legs = [math.dist(a[:2], b[:2]) for a, b in pairwise(points)][1:]
    if legs and min(legs) < 2.0 * reached_m:
        why = f"corners only {min(legs):.0f} m apart; a waypoint is reached within {reached_m:g} m"
        traffic.remark(uav.line, uav.name, f"{why}, and such corners are cut")


def _arrival_radius_m(
    uavs: Sequence[ImportedUav], fleet: PointMassPerformance, corner_m: float
) -> float:
    """A tenth of the widest turn at least, or waypoints could be circled for ever."""
    banks = ((u.speed_mps, u.max_bank_deg or fleet.max_bank_deg) for u in uavs)
    radii = (v * v / (GRAVITY_MPS2 * math.tan(math.radians(bank))) for v, bank in banks)
    widest = max(radii, default=0.0)
    return max(corner_m, float(math.ceil(0.1 * widest + 1.0)))


def _rounded(point: Point) -> list[float]:
    """To the millimetre, so that people can read it."""
    return [round(x, 3) + 0.0 for x in point]


def _rounded_down(value: float) -> float:
    return max(0.01, math.floor(100.0 * value / CLIMB_SPARE) / 100.0)


def _whole_ten(value: float) -> float:
    return min(86_400.0, 10.0 * math.ceil(value / 10.0))
