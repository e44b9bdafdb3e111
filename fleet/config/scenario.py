"""The scenario: strict, typed TOML (docs/scenarios.md explains every key).

Degrees and kilometres stay in this file and the TOML; everything derived from it is SI and radians.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct, field

from fleet.faults import registry
from fleet.model.conflict.command_set import Altitudes
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required, sample_times
from fleet.model.conflict.tracks import TrackRules
from fleet.model.conflict.zones import LEAST_ZONE, ZoneRatios
from fleet.model.election import ElectionTiming
from fleet.model.elementary import asin
from fleet.model.equipment import Equipment
from fleet.model.radio import RadioRange
from fleet.model.types import Pair
from fleet.model.units import to_ns, wrap_angle
from fleet.model.vehicle import registry as vehicles
from fleet.model.vehicle.fleet_models import FleetModels
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan, GuidanceSettings, Pilot, last_course
from fleet.model.vehicle.limits import Limits
from fleet.model.vehicle.model import Performance, VehicleModel
from fleet.model.vehicle.models.point_mass import PointMassPerformance
from fleet.model.words import Manoeuvre
from fleet.protocol.cells import Cells, cells_for

LEAST_POSITIVE = 1e-3
"""Of what is divided by: a quotient of two numbers of a scenario is finite, and none is 0."""
Positive = Annotated[float, Meta(ge=LEAST_POSITIVE, le=1e6)]
Period = Annotated[float, Meta(ge=1e-3, le=1e6)]
"""Seconds that are counted in ns, and divided by."""
NotNegative = Annotated[float, Meta(ge=0.0, le=1e6)]
Metres = Annotated[float, Meta(ge=-1e6, le=1e6)]
Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]
HalfCircle = Annotated[float, Meta(ge=0.0, le=180.0)]
Share = Annotated[float, Meta(ge=LEAST_POSITIVE, le=1.0)]
Reach = Annotated[float, Meta(ge=LEAST_POSITIVE, le=1e8)]
GrowthRate = Annotated[float, Meta(ge=0.0, le=100.0)]
CandidateCount = Annotated[int, Meta(ge=3, le=101)]
UavId = Annotated[int, Meta(ge=1, le=1_000_000)]
VerticalSpeed = Annotated[float, Meta(ge=-500.0, le=500.0)]
Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Point = tuple[Metres, Metres, Metres]


LISTENING_AHEAD_S = 2.0
"""A UAV listens so long ahead of need to where it may fly (a tick, if that is longer)."""


class ConfigTable(Struct, frozen=True, forbid_unknown_fields=True):
    """A TOML table: unknown keys are errors."""


class Zone(ConfigTable, frozen=True):
    """[zone]: the protected cylinder round each UAV."""

    radius_m: Positive = 200.0
    half_height_m: Positive = 25.0


class Guidance(ConfigTable, frozen=True):
    """[guidance]: how waypoints are flown."""

    climb_mps: Positive = 3.0
    level_off_s: Positive = 3.0
    arrival_radius_m: Positive = 100.0


class Surveillance(ConfigTable, frozen=True):
    """[surveillance]: the broadcast, when a silent track is dropped, which jumps are believed.

    And how far the radios of two UAVs reach; without it everywhere.
    """

    broadcast_s: Period = 0.2
    timeout_s: Period = 120.0
    jump_m: NotNegative = 100.0
    range_m: Reach | None = None


class Coordination(ConfigTable, frozen=True):
    """[coordination]: who elects, when conflicts are sought, how elections last and end.

    And where the coordinator is, and how far its radio reaches; without `range_m` everywhere.
    """

    electors: Literal["coordinator", "local"] = "coordinator"
    update_s: Period = 0.2
    group_hold_s: NotNegative = 2.0
    heartbeat_s: Period = 0.4
    position_ned_m: Point = (0.0, 0.0, 0.0)
    range_m: Reach | None = None
    silence_limit_s: Period = 1.5
    election_repeat_s: Period = 0.6
    election_valid_s: Period = 2.0


class Commands(ConfigTable, frozen=True):
    """[commands]: lead before a command starts, its repetition and its expiry."""

    lead_s: NotNegative = 0.2
    retransmit_s: Period = 0.6
    valid_s: Period = 2.0


class Resolution(ConfigTable, frozen=True):
    """[resolution]: T_s and T_H, TC and CC, what they cost, sectors, and how zones grow."""

    horizon_s: Annotated[float, Meta(ge=1e-3, le=600.0)] = 40.0
    climb_horizon_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 0.0
    sample_s: Annotated[float, Meta(ge=0.05, le=5.0)] = 1.0
    margin: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.05
    max_turn_deg: Annotated[float, Meta(ge=1e-3, le=180.0)] = 90.0
    turn_candidates: CandidateCount = 13
    max_climb_mps: Positive = 5.0
    max_dive_mps: Positive = 5.0
    climb_candidates: CandidateCount = 11
    turn_cost: Share = 1.0
    climb_cost: Share = 1.0
    speed_candidates: Annotated[int, Meta(ge=0, le=101)] = 0
    head_on_deg: HalfCircle = 30.0
    rear_deg: HalfCircle = 150.0
    min_altitude_m: Metres = 0.0
    max_altitude_m: Metres = 6000.0
    growth_mps: GrowthRate = 0.0
    vertical_growth_mps: GrowthRate = 0.0


class Origin(ConfigTable, frozen=True):
    """[origin]: where on Earth (WGS-84) NED 0, 0, 0 is; nothing that flies depends on it."""

    latitude_deg: Annotated[float, Meta(ge=-90.0, le=90.0)] = 47.397742
    longitude_deg: Annotated[float, Meta(ge=-180.0, le=180.0)] = 8.545594
    altitude_m: Annotated[float, Meta(ge=-1e4, le=1e5)] = 488.0


class Uav(ConfigTable, frozen=True):
    """[[uav]]: one vehicle and its flight plan."""

    id: UavId
    position_ned_m: Point
    heading_deg: Degrees
    waypoints_ned_m: Annotated[tuple[Point, ...], Meta(min_length=1, max_length=1000)]
    speed_mps: Annotated[float, Meta(gt=1.0, le=500.0)] = 25.0
    climb_mps: VerticalSpeed = 0.0
    guidance_climb_mps: Positive | None = None
    equipment: Equipment = "full"
    zone: Zone | None = None
    performance: vehicles.AnyPerformance | None = None

    def state(self) -> State:
        """Where it starts; a climb that is steeper than it is fast is refused beforehand."""
        heading_rad = wrap_angle(math.radians(self.heading_deg))
        path_rad = asin(self.climb_mps / self.speed_mps) if self.climb_mps else 0.0
        return State(*_floats(self.position_ned_m), float(self.speed_mps), heading_rad, path_rad)

    def plan(self, active: int = 0) -> FlightPlan:
        """Its waypoints, of which one is active, the first is number 0."""
        waypoints = tuple(map(_floats, self.waypoints_ned_m))
        points = (self.position_ned_m, *waypoints)
        course_rad = last_course(points, self.state().heading_rad)
        return FlightPlan(waypoints, course_rad, active)


def _floats(point: Point) -> Point:
    """A point that was given in code may have whole numbers, which messages would tell as such."""
    north, east, down = map(float, point)
    return north, east, down


class Converge(ConfigTable, frozen=True, tag="converge", tag_field="kind"):
    """[generate] kind = "converge": UAVs evenly on a circle, each bound for the opposite point."""

    count: Annotated[int, Meta(ge=1, le=1000)] = 6
    radius_m: Positive = 2000.0
    altitude_m: Positive = 300.0
    speed_mps: Annotated[float, Meta(gt=1.0, le=500.0)] = 25.0


class Crossing(ConfigTable, frozen=True, tag="crossing", tag_field="kind"):
    """[generate] kind = "crossing": random traffic in a square box of given density (per km^2)."""

    count: Annotated[int, Meta(ge=1, le=1000)] = 30
    density_per_km2: Annotated[float, Meta(ge=LEAST_POSITIVE, le=100.0)] = 0.25
    min_altitude_m: Positive = 200.0
    max_altitude_m: Positive = 400.0
    speed_mps: Annotated[float, Meta(gt=1.0, le=500.0)] = 25.0


class Scenario(ConfigTable, frozen=True):
    """A whole scenario: either [[uav]] tables or one [generate] table says who flies."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    duration_s: Annotated[float, Meta(ge=1e-3, le=86_400.0)]
    description: str = ""
    seed: Seed = 0
    tick_s: Annotated[float, Meta(ge=0.001, le=10.0)] = 0.1
    resolver: str = "geometric"
    zone: Zone = field(default_factory=Zone)
    performance: vehicles.AnyPerformance = field(default_factory=PointMassPerformance)
    guidance: Guidance = field(default_factory=Guidance)
    surveillance: Surveillance = field(default_factory=Surveillance)
    coordination: Coordination = field(default_factory=Coordination)
    commands: Commands = field(default_factory=Commands)
    resolution: Resolution = field(default_factory=Resolution)
    origin: Origin = field(default_factory=Origin)
    fault: tuple[registry.FaultRule, ...] = ()
    uav: Annotated[tuple[Uav, ...], Meta(max_length=1000)] = ()
    generate: Converge | Crossing | None = None

    @property
    def tick_ns(self) -> int:
        """Length of a tick."""
        return to_ns(self.tick_s)

    @property
    def ticks(self) -> int:
        """Number of the last tick; the first is 0."""
        return to_ns(self.duration_s) // self.tick_ns

    def performance_of(self, uav: int) -> Performance:
        """What a UAV can fly: its own table, or that of the fleet."""
        own = self._table(uav)
        return (own and own.performance) or self.performance

    def model(self, uav: int) -> VehicleModel:
        """How a UAV flies."""
        return self.performance_of(uav).model(self.guidance.level_off_s)

    def models(self) -> FleetModels:
        """How everybody flies."""
        level_off_s = self.guidance.level_off_s
        own = {u.id: u.performance.model(level_off_s) for u in self.uav if u.performance}
        return FleetModels(self.performance.model(level_off_s), own)

    def speeds_mps(self, uav: int, cruise_mps: float) -> tuple[float, float]:
        """The least and the greatest speed that a UAV of this cruise speed may be commanded."""
        return self.performance_of(uav).speeds_mps(cruise_mps)

    def pilot(self, uav: int, speed_mps: float) -> Pilot:
        """Guidance of a UAV that cruises at this speed."""
        g, own = self.guidance, self._table(uav)
        climb_mps = (own and own.guidance_climb_mps) or g.climb_mps
        settings = GuidanceSettings(speed_mps, climb_mps, g.level_off_s, g.arrival_radius_m)
        table = (own and own.performance) or self.performance
        return Pilot(settings, table.model(g.level_off_s))

    def _table(self, uav: int) -> Uav | None:
        """The table of a UAV; generated ones have none."""
        return next((u for u in self.uav if u.id == uav), None)

    def radio(self) -> RadioRange:
        """How far radios reach, and how far a UAV flies while it listens ahead."""
        fastest_mps = max(table.speeds_mps(speed)[1] for table, speed in self._cruising().items())
        margin_m = fastest_mps * max(LISTENING_AHEAD_S, self.tick_s)
        return RadioRange(self.surveillance.range_m, self.coordination.range_m, margin_m)

    def cells(self) -> Cells | None:
        """The cells that UAVs broadcast to; None: to all."""
        return cells_for(self.radio())

    def zone_of(self, uav: int) -> Zone:
        """The protected zone of a UAV."""
        own = self._table(uav)
        return (own and own.zone) or self.zone

    def required(self) -> Required:
        """Least distances of two UAVs with the least zones."""
        zones = [u.zone or self.zone for u in self.uav] or [self.zone]
        radius_m = min(z.radius_m for z in zones)
        return Required(2.0 * radius_m, 2.0 * min(z.half_height_m for z in zones))

    def required_of(self, pair: Pair) -> Required:
        """Least distances of two UAVs: the sums of the sizes of their zones (eq. 8)."""
        return self.zone_ratios().of_pair(pair, self.required())

    def zone_ratios(self) -> ZoneRatios:
        """Whose zone is larger than the least, and how many times."""
        least = self.required()
        ratios = {
            u.id: (
                2.0 * zone.radius_m / least.horizontal_m,
                2.0 * zone.half_height_m / least.vertical_m,
            )
            for u, zone in ((u, u.zone or self.zone) for u in self.uav)
        }
        return ZoneRatios({uav: ratio for uav, ratio in ratios.items() if ratio != LEAST_ZONE})

    def altitudes(self) -> Altitudes:
        """Between which altitudes manoeuvres stay."""
        return Altitudes(-self.resolution.min_altitude_m, -self.resolution.max_altitude_m)

    def track_rules(self) -> TrackRules:
        """What becomes of tracks."""
        s, silence_s = self.surveillance, self.coordination.silence_limit_s
        acceleration = max(limits.acceleration_mps2 for _, limits in self._fastest())
        return TrackRules(
            to_ns(silence_s), to_ns(s.timeout_s), s.jump_m, acceleration, to_ns(s.broadcast_s)
        )

    def election_timing(self) -> ElectionTiming:
        """How elections last and end."""
        c = self.coordination
        return ElectionTiming(
            to_ns(c.election_repeat_s), to_ns(c.election_valid_s), to_ns(c.silence_limit_s)
        )

    def outlook(self) -> Outlook:
        """What the alert looks at: T_s, and the separation required."""
        r = self.resolution
        return Outlook(
            self.models(),
            sample_times(r.horizon_s, r.sample_s),
            self._wide(1.0, r.sample_s),
            self.zone_ratios(),
        )

    def ahead_s(self, manoeuvre: str) -> float:
        """How far ahead a manoeuvre is looked at: T_H for a climb, T_s for a turn.

        Of both together the longer. A manoeuvre must be free for twice as long.
        """
        r = self.resolution
        climb_s = r.climb_horizon_s or r.horizon_s
        if manoeuvre == Manoeuvre.CLIMB:
            return climb_s
        return max(climb_s, r.horizon_s) if manoeuvre == Manoeuvre.TURN_CLIMB else r.horizon_s

    def manoeuvre_outlook(self, every: int = 1) -> Outlook:
        """What a manoeuvre or a return must be free of: twice T_s, and a margin on the separation.

        Twice, or one could be "safe" only because what it meets lies just behind T_s. (Where
        T_H is longer, twice that.) Of the samples only one in so many (1 or 2) is taken.
        """
        times = self.outlook().times_s
        doubled = np.concatenate([times, times[-1] + times[1:]])
        longer_s = 2.0 * self.ahead_s(Manoeuvre.CLIMB) - doubled[-1]
        if longer_s > 0.0:
            step_s = times[1]
            more = step_s * np.arange(1, math.ceil(longer_s / step_s) + 1)
            doubled = np.concatenate([doubled, doubled[-1] + more])
        doubled = doubled[::every]
        required = self._wide(1.0 + self.resolution.margin, every * self.resolution.sample_s)
        return Outlook(self.models(), doubled, required, self.zone_ratios())

    def _wide(self, factor: float, step_s: float) -> Required:
        """The required separation times a factor, widened for what lies between two samples."""
        required = self.required()
        scaled = Required(required.horizontal_m * factor, required.vertical_m * factor)
        speeds = self.resolution.speed_candidates > 0
        wide = [
            scaled.widened(limits, fastest, step_s, limits.acceleration_mps2 if speeds else 0.0)
            for fastest, limits in self._fastest()
        ]
        return Required(max(w.horizontal_m for w in wide), max(w.vertical_m for w in wide))

    def _fastest(self) -> list[tuple[float, Limits]]:
        """The greatest speed that is flown with each performance, and the limits with it."""
        commanded = self.resolution.speed_candidates > 0
        return [
            (
                table.speeds_mps(speed)[1] if commanded else speed,
                table.model(self.guidance.level_off_s).limits,
            )
            for table, speed in self._cruising().items()
        ]

    def _cruising(self) -> dict[Performance, float]:
        """The greatest cruise speed with each performance."""
        generated_mps = self.generate.speed_mps if self.generate else 0.0
        fastest: dict[Performance, float] = {} if self.uav else {self.performance: generated_mps}
        for uav in self.uav:
            table = uav.performance or self.performance
            fastest[table] = max(uav.speed_mps, fastest.get(table, 0.0))
        return fastest
