"""BlueSky scenarios (`.scn`): what their commands make of aircraft.

Taken over are CRE, CRECONFS, HDG, ALT, VS, SPD, ADDWPT, DEST, DEFWPT, BANK, and of the protected
zone ZONER, ZONEDH and DTLOOK. Each command acts at its time on an aircraft that is dead reckoned to
there. Everything else gets a remark; what only shows, paces or records is counted in one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from fleet.config.scenario import Origin, Zone
from fleet.imports.approach import latest_approach_s
from fleet.imports.bluesky_conflict import meeting_point
from fleet.imports.bluesky_text import (
    StackCommand,
    airspeed_mps,
    altitude_m,
    climb_mps,
    heading_deg,
    is_latitude,
    latitude_deg,
    longitude_deg,
    number_of,
    stack_commands,
)
from fleet.imports.bluesky_words import AVOIDANCE, OTHER_NAMES, SHOWING, WAYPOINT_MODES, WHY_NOT
from fleet.imports.foreign_units import FEET_A_MINUTE_TO_MPS, FEET_TO_M, NAUTICAL_MILES_TO_M
from fleet.imports.imported import SLOWEST_MPS, ForeignSettings, ForeignTraffic
from fleet.imports.local_frame import LocalFrame, middle_of
from fleet.imports.reckoned_flight import ReckonedFlight, RoutePoint

REQUIRED_NMI, REQUIRED_FT = 5.0, 1000.0
"""BlueSky's default separation; its zone is around one aircraft, ours are half as wide."""

CLIMB_MPS = 1500.0 * FEET_A_MINUTE_TO_MPS
"""With which BlueSky climbs where no vertical speed is told."""

ROUTE_SLOPE = 3000.0 * FEET_TO_M / (10.0 * NAUTICAL_MILES_TO_M)
"""At which it climbs to the altitude of a waypoint, and descends from it."""

LEAST_S = 120.0
"""Traffic is flown for so long at least."""

BLUESKY = ForeignSettings(
    Zone(REQUIRED_NMI * NAUTICAL_MILES_TO_M / 2.0, REQUIRED_FT * FEET_TO_M / 2.0), 300.0, 25.0
)
"""Its defaults: separation, how far ahead it looks (DTLOOK), how it banks."""


def read_bluesky(lines: Sequence[str], origin: Origin | None) -> ForeignTraffic:
    """The traffic of a scenario, about this origin, or else one in the middle of who is created."""
    traffic = ForeignTraffic("BlueSky", BLUESKY, origin or Origin())
    commands = stack_commands(lines, traffic)
    reading = BlueSkyReading(traffic, commands, origin)
    for command in commands:
        reading.take(command)
    reading.finish()
    return traffic


class BlueSkyReading:
    """A scenario as it is read, command by command."""

    def __init__(
        self, traffic: ForeignTraffic, commands: Sequence[StackCommand], origin: Origin | None
    ) -> None:
        self.traffic = traffic
        self._named: dict[str, tuple[float, float]] = {}
        self._flights: dict[str, ReckonedFlight] = {}
        self._aside: Counter[str] = Counter()
        self._told_m: dict[str, float] = {}
        self._separation = (REQUIRED_NMI * NAUTICAL_MILES_TO_M, REQUIRED_FT * FEET_TO_M)
        self._take: dict[str, Callable[[StackCommand], None]] = {
            "CRE": self._create,
            "CRECONFS": self._create_in_conflict,
            "DEFWPT": self._define,
            "HDG": self._heading,
            "ALT": self._altitude,
            "VS": self._vertical_speed,
            "SPD": self._speed,
            "ADDWPT": self._waypoint,
            "DEST": self._waypoint,
            "BANK": self._bank,
            "ZONER": self._zone,
            "ZONEDH": self._zone,
            "DTLOOK": self._look_ahead,
            "LNAV": self._navigation,
            "VNAV": self._navigation,
        }
        traffic.origin = origin or self._middle(commands)
        self._frame = LocalFrame(traffic.origin)

    def _middle(self, commands: Sequence[StackCommand]) -> Origin:
        """In the middle of who is created."""
        points = []
        for command in commands:
            if OTHER_NAMES.get(command.name, command.name) == "CRE":
                try:
                    points.append(self._place(command.arguments, 2)[0])
                except ValueError:
                    continue  # which is told when it is read
        return middle_of(*zip(*points, strict=True)) if points else Origin()

    def take(self, command: StackCommand) -> None:
        """Do what one command says, or remark that it is not done."""
        if command.name in self._flights and command.arguments:
            command = StackCommand(
                command.line,
                command.time_s,
                command.arguments[0].upper(),
                (command.name, *command.arguments[1:]),
            )
        name = OTHER_NAMES.get(command.name, command.name)
        command = StackCommand(command.line, command.time_s, name, command.arguments)
        if name in self._take:
            try:
                self._take[name](command)
            except (ValueError, OverflowError) as error:
                self._remark(command, str(error))
        elif name in WHY_NOT or (
            command.argument(0).upper() in self._flights and name not in SHOWING | AVOIDANCE
        ):
            if command.argument(0).upper() != "OFF":
                self._remark(command, WHY_NOT.get(name, "a command that is not taken over"))
        else:
            self._aside[name] += 1

    def finish(self) -> None:
        """Everybody as UAVs, from the time on at which the first one is created."""
        flights = list(self._flights.values())
        begin_s = min((f.created_s for f in flights), default=0.0)
        now_s = max((f.time_s for f in flights), default=0.0)
        for flight in flights:
            flight.advance(now_s)
        end_s = now_s + self._to_come_s(flights)
        self.traffic.duration_s = end_s - begin_s
        for flight in flights:
            late_s = flight.created_s - begin_s
            if late_s > 0.0:
                self.traffic.remark(
                    flight.line,
                    f"CRE {flight.name}",
                    f"created {late_s:g} s after the first aircraft; it begins with all others, "
                    f"{late_s * flight.speed_mps:.0f} m further back",
                )
            if len(flight.rates_mps) > 1:
                rates = ", ".join(f"{rate:.1f}" for rate in sorted(flight.rates_mps))
                self.traffic.remark(
                    flight.line,
                    f"CRE {flight.name}",
                    f"climbs and descends at {rates} m/s; a UAV always at the greatest",
                )
            self.traffic.uavs.append(flight.finished(end_s, begin_s))
        self._tell_aside()

    def _to_come_s(self, flights: Sequence[ReckonedFlight]) -> float:
        """How long it takes from now on to the latest CPA, and to the end of all routes."""
        if not flights:
            return 0.0
        moving = [f for f in flights if f.speed_mps > SLOWEST_MPS]
        places = np.array([f.place()[:2] for f in moving])
        velocities = np.array([f.velocity_mps() for f in moving])
        latest = latest_approach_s(places, velocities, 3.0 * self._separation[0])
        routes = []
        for flight in flights:
            if flight.route and flight.speed_mps > 0.0:
                points = [flight.place()[:2], *((p.north_m, p.east_m) for p in flight.route)]
                legs = (math.dist(a, b) for a, b in pairwise(points))
                routes.append(sum(legs) / flight.speed_mps)
        return max([LEAST_S, 1.1 * latest + 30.0, *routes])

    def _tell_aside(self) -> None:
        unknown = self._aside.keys() - SHOWING - AVOIDANCE
        for names, why in (
            (SHOWING, "show, pace, record or name, and change no flight"),
            (
                AVOIDANCE,
                "settings of BlueSky's own avoidance; here a resolver of this project acts",
            ),
            (unknown, "not known here, and not taken over"),
        ):
            told = ", ".join(f"{n} ({self._aside[n]})" for n in sorted(self._aside) if n in names)
            if told:
                self.traffic.remark(0, told, why)

    def _remark(self, command: StackCommand, why: str) -> None:
        of = f" {command.argument(0)}" if command.argument(0) else ""
        self.traffic.remark(command.line, f"{command.name}{of}", why)

    def _flight(self, command: StackCommand) -> ReckonedFlight:
        """The aircraft that is told something, flown on to now; raises ValueError."""
        flight = self._flights.get(command.argument(0).upper())
        if flight is None:
            raise ValueError("no such aircraft has been created, or it could not be taken over")
        flight.advance(max(command.time_s, flight.time_s))
        return flight

    def _place(self, words: Sequence[str], at: int) -> tuple[tuple[float, float], int]:
        """Latitude and longitude of a position in words, and where the next argument is."""
        word = words[at] if at < len(words) else ""
        if not word:
            raise ValueError("no position is given")
        if is_latitude(word):
            if at + 1 >= len(words):
                raise ValueError(f"'{word}' is a latitude, and no longitude follows")
            return (latitude_deg(word), longitude_deg(words[at + 1])), at + 2
        if word.upper() in self._flights:
            flight = self._flights[word.upper()]
            return self._frame.geodetic_deg(flight.north_m, flight.east_m), at + 1
        try:
            return self._named[word.upper()], at + 1
        except KeyError:
            raise ValueError(
                f"'{word}' is not defined in the file (BlueSky looks it up in its navigation data)"
            ) from None

    def _define(self, command: StackCommand) -> None:
        place, _ = self._place(command.arguments, 1)
        self._named[command.argument(0).upper()] = place

    def _create(self, command: StackCommand) -> None:
        name = command.argument(0).upper()
        if not name:
            raise ValueError("no name is given")
        (latitude, longitude), rest = self._place(command.arguments, 2)
        heading, altitude, speed = (command.argument(rest + k) for k in range(3))
        height_m = altitude_m(altitude or "0")
        north, east = self._frame.point_m(latitude, longitude)
        course = self._frame.course_rad(north, east, heading_deg(heading or "0"))
        self._new(
            command, name, (north, east, height_m, course, airspeed_mps(speed or "0", height_m))
        )

    def _new(
        self, command: StackCommand, name: str, state: tuple[float, ...]
    ) -> ReckonedFlight | None:
        if name in self._flights:
            self._remark(command, "there is an aircraft of this name already, as for BlueSky")
            return None
        north, east, height_m, course, speed_mps = state
        flight = self._flights[name] = ReckonedFlight(
            name=name,
            line=command.line,
            time_s=command.time_s,
            north_m=north,
            east_m=east,
            altitude_m=height_m - self.traffic.origin.altitude_m,
            course_rad=course,
            speed_mps=speed_mps,
            rate_mps=CLIMB_MPS,
        )
        return flight

    def _create_in_conflict(self, command: StackCommand) -> None:
        name, target = command.argument(0).upper(), command.argument(2).upper()
        other = self._flights.get(target)
        if other is None:
            raise ValueError(f"its target '{target}' has not been created, or is not taken over")
        other.advance(max(command.time_s, other.time_s))
        height_m = other.altitude_m + self.traffic.origin.altitude_m
        found = meeting_point(command, other, height_m, self._separation)
        height_m += found.above_m
        state = (found.north_m, found.east_m, height_m, found.course_rad, found.speed_mps)
        flight = self._new(command, name, state)
        if flight is not None and found.climb_mps:
            flight.climb_to(other.altitude_m, found.climb_mps)

    def _heading(self, command: StackCommand) -> None:
        flight = self._flight(command)
        true_deg = heading_deg(command.argument(1))
        flight.turn(self._frame.course_rad(flight.north_m, flight.east_m, true_deg))

    def _altitude(self, command: StackCommand) -> None:
        flight = self._flight(command)
        height_m = altitude_m(command.argument(1)) - self.traffic.origin.altitude_m
        told = climb_mps(command.argument(2)) if command.argument(2) else 0.0
        told = told or self._told_m.get(flight.name, 0.0)
        if told * (height_m - flight.altitude_m) < 0.0:  # the other way: as if none were told
            told = 0.0
        self._told_m[flight.name] = told
        flight.climb_to(height_m, abs(told) or CLIMB_MPS)

    def _vertical_speed(self, command: StackCommand) -> None:
        flight = self._flight(command)
        told = self._told_m[flight.name] = climb_mps(command.argument(1))
        if flight.target_m != flight.altitude_m and told:
            flight.climb_to(flight.target_m, abs(told))

    def _speed(self, command: StackCommand) -> None:
        flight = self._flight(command)
        height_m = flight.altitude_m + self.traffic.origin.altitude_m
        speed = airspeed_mps(command.argument(1), height_m)
        if not flight.new:
            raise ValueError(
                f"a change of speed under way; it flies on at {flight.speed_mps:.1f} m/s"
            )
        if speed != flight.speed_mps:
            self._remark(command, f"flown at {speed:.1f} m/s from the start")
        flight.speed_mps = speed

    def _waypoint(self, command: StackCommand) -> None:
        flight = self._flight(command)
        mode = command.argument(1).upper().replace("-", "")
        if mode in WAYPOINT_MODES:
            self._remark(command, f"{mode}: how waypoints are passed is not taken over")
            return
        (latitude, longitude), rest = self._place(command.arguments, 1)
        altitude, speed = command.argument(rest), command.argument(rest + 1)
        height_m = None
        if command.name == "DEST":
            speed = altitude
            self._remark(command, "taken for a waypoint; BlueSky descends to it, to altitude 0")
        elif altitude:
            height_m = altitude_m(altitude) - self.traffic.origin.altitude_m
            if height_m != flight.target_m:
                flight.rate_mps = ROUTE_SLOPE * flight.speed_mps
                flight.rates_mps.add(flight.rate_mps)
        if speed:
            self._remark(command, "the speed at the waypoint is not taken over")
        if command.argument(rest + 2) or command.argument(rest + 3):
            self._remark(command, "its place in the route is not taken over; it comes last")
        place = self._frame.point_m(latitude, longitude)
        flight.add(RoutePoint(*place, height_m, last=command.name == "DEST"))

    def _bank(self, command: StackCommand) -> None:
        self._flight(command).max_bank_deg = number_of(command.argument(1))

    def _zone(self, command: StackCommand) -> None:
        if command.argument(1):
            raise ValueError(
                "a zone of some aircraft alone: of two there the greater counts, here their sum; "
                "give [[uav]] zone"
            )
        value = number_of(command.argument(0))
        across, high = self._separation
        if command.name == "ZONER":
            across = value * NAUTICAL_MILES_TO_M
        else:
            high = value * FEET_TO_M
        self._separation = (across, high)
        s = self.traffic.settings
        self.traffic.settings = ForeignSettings(
            Zone(across / 2.0, high / 2.0), s.horizon_s, s.max_bank_deg
        )

    def _look_ahead(self, command: StackCommand) -> None:
        if command.argument(1):
            raise ValueError("a look-ahead of some aircraft alone; all keep that of the fleet")
        s = self.traffic.settings
        ahead_s = number_of(command.argument(0))
        self.traffic.settings = ForeignSettings(s.zone, ahead_s, s.max_bank_deg)

    def _navigation(self, command: StackCommand) -> None:
        if command.argument(1).upper() not in ("ON", "TRUE", "1", "YES", ""):
            raise ValueError("a UAV flies its waypoints and their altitudes all the time")
