"""Dead reckoning of an aircraft that is told what to do: straight legs at a constant speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from fleet.config.scenario import Point
from fleet.imports.imported import ImportedUav

AT_CREATION_S = 1e-6
"""What is told within this time of the creation is told with it."""


@dataclass(slots=True)
class RoutePoint:
    """A waypoint that is still to be flown; no altitude: as it is by then. `last` stays last."""

    north_m: float
    east_m: float
    altitude_m: float | None
    last: bool = False


@dataclass(slots=True)
class ReckonedFlight:
    """Where an aircraft is by now, what it has been told, and what it has flown.

    NED from the origin's altitude up: `altitude_m` is above it. `rate_mps` is how fast altitude
    changes, `target_m` to what.
    """

    name: str
    line: int
    time_s: float
    north_m: float
    east_m: float
    altitude_m: float
    course_rad: float
    speed_mps: float
    rate_mps: float
    target_m: float = 0.0
    climb_mps: float = 0.0
    max_bank_deg: float | None = None
    route: list[RoutePoint] = field(default_factory=list)
    flown: list[Point] = field(default_factory=list)
    rates_mps: set[float] = field(default_factory=set)
    created_s: float = 0.0
    start: Point = (0.0, 0.0, 0.0)
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        """It begins as it is told."""
        self.target_m, self.created_s = self.altitude_m, self.time_s
        self.start = self.place()
        self.heading_deg = math.degrees(self.course_rad)

    @property
    def new(self) -> bool:
        """Whether it has not flown yet."""
        return self.time_s - self.created_s <= AT_CREATION_S

    def place(self) -> Point:
        """Where it is, NED."""
        return (self.north_m, self.east_m, -self.altitude_m + 0.0)

    def velocity_mps(self) -> tuple[float, float]:
        """North and east, level."""
        return (
            self.speed_mps * math.cos(self.course_rad),
            self.speed_mps * math.sin(self.course_rad),
        )

    def advance(self, time_s: float) -> None:
        """Fly on to a time."""
        left = time_s - self.time_s
        self.time_s = time_s
        while self.route and left > 0.0:
            point = self.route[0]
            away = math.hypot(point.north_m - self.north_m, point.east_m - self.east_m)
            if away > left * self.speed_mps:
                self._turn_to(point)
                break
            self._pass(point)
            left -= away / self.speed_mps
            self._climb(away / self.speed_mps)
            if self.route:
                self._turn_to(self.route[0])
        north, east = self.velocity_mps()
        self.north_m += left * north
        self.east_m += left * east
        self._climb(left)

    def _turn_to(self, point: RoutePoint) -> None:
        self.course_rad = math.atan2(point.east_m - self.east_m, point.north_m - self.north_m)

    def _pass(self, point: RoutePoint) -> None:
        if (point.north_m, point.east_m) != (self.north_m, self.east_m):
            self._turn_to(point)
        self._altitude_for(0)
        self.north_m, self.east_m = point.north_m, point.east_m
        self.flown.append((point.north_m, point.east_m, -self.target_m + 0.0))
        self.route.pop(0)

    def _altitude_for(self, place: int) -> None:
        """Set the altitude that is flown to on the way to a point of the route.

        That of the next point that has one: at once if it is higher, if lower only from the point
        before it on.
        """
        ahead = next((p.altitude_m for p in self.route[place:] if p.altitude_m is not None), None)
        own = self.route[place].altitude_m
        if own is not None:
            self.target_m = own
        elif ahead is not None and ahead > self.target_m:
            self.target_m = ahead

    def _climb(self, span_s: float) -> None:
        step = self.rate_mps * span_s
        self.altitude_m += max(-step, min(step, self.target_m - self.altitude_m))

    def turn(self, course_rad: float) -> None:
        """Fly another course from here on, and no route any more."""
        self.corner()
        self.route.clear()
        self.course_rad = course_rad

    def corner(self) -> None:
        """Something changes here: a waypoint, if it has flown to here."""
        if not self.new:
            self.flown.append((self.north_m, self.east_m, -self.target_m + 0.0))

    def climb_to(self, altitude_m: float, rate_mps: float) -> None:
        """Fly to another altitude from here on; at its creation it is in the climb at once."""
        if self.new:
            height = altitude_m - self.altitude_m
            self.climb_mps = math.copysign(rate_mps, height) if height else 0.0
        elif altitude_m != self.target_m:
            self.corner()
        for point in self.route:
            point.altitude_m = None
        self.target_m, self.rate_mps = altitude_m, rate_mps
        if altitude_m != self.altitude_m:
            self.rates_mps.add(rate_mps)

    def add(self, point: RoutePoint) -> None:
        """A further waypoint; the first one is flown to from here. There is one last at most."""
        if not self.route:
            self.corner()
        goal = [p for p in self.route if p.last]
        others = [p for p in self.route if not p.last]
        self.route = [*others, point] if point.last else [*others, point, *goal]

    def finished(self, end_s: float, begin_s: float) -> ImportedUav:
        """As a UAV that is there from `begin_s` on, and flies straight on after `end_s` at least.

        Who is created later is further back by then, on the course of its creation.
        """
        waypoints = list(self.flown)
        for place, point in enumerate(self.route):
            self._altitude_for(place)
            waypoints.append((point.north_m, point.east_m, -self.target_m + 0.0))
        if not self.route:
            north, east = self.velocity_mps()
            ahead = max(end_s - self.time_s, 10.0)
            waypoints.append(
                (self.north_m + ahead * north, self.east_m + ahead * east, -self.target_m + 0.0)
            )
        late, (north, east, down) = self.created_s - begin_s, self.start
        back, climb = late * self.speed_mps, self.climb_mps
        if late > AT_CREATION_S:
            if climb:
                waypoints.insert(0, self.start)
                climb = 0.0
            course = math.radians(self.heading_deg)
            north, east = north - back * math.cos(course), east - back * math.sin(course)
        return ImportedUav(
            name=self.name,
            line=self.line,
            position_ned_m=(north, east, down),
            heading_deg=self.heading_deg,
            speed_mps=math.hypot(self.speed_mps, climb),
            waypoints_ned_m=tuple(waypoints),
            climb_mps=climb,
            guidance_climb_mps=max(self.rates_mps, default=None),
            max_bank_deg=self.max_bank_deg,
        )
