"""Sets of encounters, each encounter a pure function of its seed.

    pairs       two UAVs at 12 to 40 m/s, at all angles, many climbing, descending or turning
    converging  3 to 12 UAVs from all sides, through one place at about one time
    circle      8 or 16 UAVs evenly on a circle, all bound through its centre
    matrix      two rows abreast, of 4 or 8, that cross at right angles
    takeover    4 or 8 UAVs on one track, each behind a slower one
    overtake    two UAVs on one track, the one behind faster by 0.5 to 4 m/s
    late        two UAVs whose conflict nobody can see earlier than 8 to 30 s before the loss:
                they start so near, or a turn or climb of the plan leads into it

Circle, matrix and takeover are those that BlueSky makes under like names. Every encounter is flown
by its plans before it is taken: without avoidance separation is lost, nobody starts inside
another's zone, and the first loss comes later than 40 s (late ones: 8 s) after the start. The last
waypoint lies beyond the encounter; undisturbed, the last UAV arrives at 45 percent of the duration.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import msgspec

from benchmarks.flown import Path, first_loss_s, path_of
from fleet.config.scenario import Resolution, Scenario, Uav

ATTEMPTS = 1000
REQUIRED_M = 400.0
REQUIRED_VERTICAL_M = 50.0
ARRIVAL_M = 100.0
CLIMB_MPS = 3.0
"""Of a default scenario: the distances required, the radius of arrival, guidance's climb."""

FIRST_LOSS_S = 40.0
LATE_S = (8.0, 30.0)
ARRIVAL_SHARE = 0.45


PLAIN = Scenario("plain", 1.0)


@dataclass(frozen=True)
class Bend:
    """A turn in the plan, so long after the reference time (before it, if negative)."""

    after_s: float
    turn_rad: float


@dataclass(frozen=True)
class Course:
    """A flight through a place: where it is at the reference time, and how it comes and goes on.

    `climb` is 1, 0 or -1; guidance climbs from the start and is level `level_after_s` after the
    reference time. With `step` it is level until the bend and climbs from there.
    """

    place: tuple[float, float, float]
    heading_rad: float
    speed_mps: float
    before_s: float
    after_s: float
    bend: Bend | None = None
    climb: int = 0
    level_after_s: float = 0.0
    step: bool = False

    def uav(self, number: int) -> Uav:
        """The UAV that flies it."""
        bend = self.bend or Bend(0.0, 0.0)
        here = self.place[:2]
        came = self.heading_rad - (bend.turn_rad if bend.after_s < 0.0 else 0.0)
        goes = self.heading_rad + (bend.turn_rad if bend.after_s > 0.0 else 0.0)
        corner = self._along(here, self.heading_rad, bend.after_s)
        start = self._along(corner, came, -self.before_s - bend.after_s)
        goal = self._along(corner, goes, self.after_s - bend.after_s)
        if bend.after_s >= 0.0:
            start = self._along(here, came, -self.before_s)
        else:
            goal = self._along(here, goes, self.after_s)
        low, high = self._altitudes(bend)
        points = [(goal, high)]
        if self.bend:
            points.insert(0, (corner, low if self.step else high))
        return Uav(
            number,
            _rounded(start, low),
            round(math.degrees(came) % 360.0, 2),
            tuple(_rounded(*p) for p in points),
            self.speed_mps,
        )

    def _altitudes(self, bend: Bend) -> tuple[float, float]:
        """At the start and at the end."""
        here_m, rate = self.place[2], self.climb * CLIMB_MPS
        begins_s = bend.after_s - ARRIVAL_M / self.speed_mps if self.step else -self.before_s
        end_s = self.level_after_s
        return here_m - rate * (min(end_s, 0.0) - begins_s), here_m + rate * max(end_s, 0.0)

    def _along(
        self, place: Sequence[float], heading_rad: float, time_s: float
    ) -> tuple[float, ...]:
        distance = self.speed_mps * time_s
        return (
            place[0] + distance * math.cos(heading_rad),
            place[1] + distance * math.sin(heading_rad),
        )


def _rounded(place: Sequence[float], altitude_m: float) -> tuple[float, float, float]:
    return (round(place[0], 1), round(place[1], 1), -round(altitude_m, 1))


def scenario_of(name: str, seed: int) -> Scenario:
    """The encounter of a set and seed (from 1 on), with default settings.

    Climbs and dives are limited to what the slowest UAV can fly.
    """
    uavs = SETS[name].uavs(seed)
    longest_s = 0.0
    for uav in uavs:
        legs = [uav.position_ned_m, *uav.waypoints_ned_m]
        length = sum(math.dist(a[:2], b[:2]) for a, b in pairwise(legs))
        longest_s = max(longest_s, length / uav.speed_mps)
    duration_s = float(math.ceil(longest_s / ARRIVAL_SHARE))
    slowest_mps = min(u.speed_mps for u in uavs)
    climb_mps = min(
        5.0,
        math.floor(10.0 * slowest_mps * math.sin(PLAIN.model(0).limits.steepest_rad(slowest_mps)))
        / 10.0,
    )
    limits = Resolution(max_climb_mps=climb_mps, max_dive_mps=climb_mps)
    return Scenario(f"{name}-{seed}", duration_s, seed=seed, resolution=limits, uav=uavs)


def pairs(seed: int) -> tuple[Uav, ...]:
    """Two UAVs that meet at an angle which goes once round in 400 seeds."""
    rng = random.Random(f"pairs {seed}")
    angle_rad = math.radians(0.9 * (seed % 400) + rng.uniform(0.0, 0.9))
    for _ in range(ATTEMPTS):
        loss_s, heading_rad = rng.uniform(45.0, 70.0), rng.uniform(0.0, math.tau)
        one, two = _meeting(rng, heading_rad, angle_rad, loss_s)
        uavs = (_varied(rng, one).uav(1), _varied(rng, two).uav(2))
        if FIRST_LOSS_S < _first_loss_s([path_of(u, PLAIN, 90.0) for u in uavs]) < math.inf:
            return uavs
    raise RuntimeError(f"no pair for seed {seed}")


def late(seed: int) -> tuple[Uav, ...]:
    """Two UAVs in a conflict that shows late: by a turn, by a climb, or from the start."""
    rng = random.Random(f"late {seed}")
    kind = ("turn", "climb", "start")[seed % 3]
    for _ in range(ATTEMPTS):
        loss_s = rng.uniform(*LATE_S) if kind == "start" else rng.uniform(50.0, 70.0)
        heading_rad, angle_rad = (rng.uniform(0.0, math.tau) for _ in range(2))
        one, two = _meeting(rng, heading_rad, angle_rad, loss_s)
        if kind == "turn":
            turn_rad = rng.choice((-1.0, 1.0)) * math.radians(rng.uniform(30.0, 120.0))
            two = replace(two, bend=Bend(_corner_s(rng, two), turn_rad))
        elif kind == "climb":
            two = _stepping(rng, two)
        uavs = (one.uav(1), two.uav(2))
        if rng.random() < 0.5:
            uavs = (two.uav(1), one.uav(2))
        if _is_late(uavs, kind):
            return uavs
    raise RuntimeError(f"no late encounter for seed {seed}")


def converging(seed: int) -> tuple[Uav, ...]:
    """3 to 12 UAVs of any heading and speed, near one place at about one time."""
    rng = random.Random(f"converging {seed}")
    count = 3 + seed % 10
    for _ in range(ATTEMPTS):
        meet_s = rng.uniform(60.0, 75.0)
        uavs, paths = list[Uav](), list[Path]()
        for _ in range(ATTEMPTS):
            place = tuple(rng.uniform(-x, x) for x in (300.0, 300.0, 40.0))
            course = Course(
                (place[0], place[1], 500.0 + place[2]),
                rng.uniform(0.0, math.tau),
                round(rng.uniform(12.0, 40.0), 1),
                meet_s + rng.uniform(-6.0, 6.0),
                rng.uniform(60.0, 90.0),
            )
            uav = _varied(rng, course).uav(len(uavs) + 1)
            path = path_of(uav, PLAIN, 150.0)
            first = [first_loss_s(p, path, PLAIN.required()) for p in paths]
            if not first or (min(first) > FIRST_LOSS_S and min(first) < math.inf):
                uavs.append(uav)
                paths.append(path)
            if len(uavs) == count:
                return tuple(uavs)
    raise RuntimeError(f"no converging encounter for seed {seed}")


def circle(count: int) -> Callable[[int], tuple[Uav, ...]]:
    """UAVs evenly on a circle; other seeds than 1 have other sizes, speeds and orders."""

    def uavs(seed: int) -> tuple[Uav, ...]:
        rng = random.Random(f"circle {count} {seed}")
        radius_m, speed_mps, first_rad = 2100.0, 25.0, -math.pi / 2
        order = list(range(1, count + 1))
        if seed > 1:
            radius_m, speed_mps = rng.uniform(2100.0, 3000.0), rng.uniform(20.0, 28.0)
            first_rad = rng.uniform(0.0, math.tau)
            rng.shuffle(order)
        reach_s = radius_m / speed_mps
        out = []
        for k, number in enumerate(order):
            heading_rad = first_rad + math.tau * k / count + math.pi
            course = Course((0.0, 0.0, 500.0), heading_rad, speed_mps, reach_s, reach_s)
            out.append(course.uav(number))
        return _in_order(out)

    return uavs


def matrix(count: int) -> Callable[[int], tuple[Uav, ...]]:
    """Half of the UAVs abreast flying east, half flying north, through each other's rows."""

    def uavs(seed: int) -> tuple[Uav, ...]:
        rng = random.Random(f"matrix {count} {seed}")
        size, speed_mps = count // 2, 25.0 if seed == 1 else rng.uniform(18.0, 34.0)
        apart_m = 600.0 if seed == 1 else rng.uniform(450.0, 900.0)
        order = list(range(1, count + 1))
        if seed > 1:
            rng.shuffle(order)
        before_s = 60.0 + REQUIRED_M / speed_mps
        after_s = 60.0 + size * apart_m / speed_mps
        out = []
        for k, number in enumerate(order):
            aside_m = (k % size) * apart_m
            place = (aside_m, 0.0, 500.0) if k < size else (0.0, aside_m, 500.0)
            heading_rad = math.pi / 2 if k < size else 0.0
            out.append(Course(place, heading_rad, speed_mps, before_s, after_s).uav(number))
        return _in_order(out)

    return uavs


def takeover(count: int) -> Callable[[int], tuple[Uav, ...]]:
    """One track, the slowest ahead, so that each overtakes all in front of it."""

    def uavs(seed: int) -> tuple[Uav, ...]:
        rng = random.Random(f"takeover {count} {seed}")
        slowest = 14.0 if seed == 1 else rng.uniform(12.0, 20.0)
        fastest = 34.0 if seed == 1 else rng.uniform(28.0, 40.0)
        order = list(range(1, count + 1))
        if seed > 1:
            rng.shuffle(order)
        return _on_one_track(order, slowest, (fastest - slowest) / (count - 1))

    return uavs


def overtake(seed: int) -> tuple[Uav, ...]:
    """Two on one track, the one behind faster by so little that passing would take minutes."""
    rng = random.Random(f"overtake {seed}")
    slower_mps = 25.0 if seed == 1 else rng.uniform(14.0, 34.0)
    faster_mps = 1.0 if seed == 1 else rng.uniform(0.5, 4.0)
    return _on_one_track([2, 1] if seed % 2 == 0 else [1, 2], slower_mps, faster_mps)


def _on_one_track(order: Sequence[int], slowest: float, faster_mps: float) -> tuple[Uav, ...]:
    """Each faster by so much than the one in front of it, whom it meets in 50 s."""
    apart_m = REQUIRED_M + 50.0 * faster_mps
    out = []
    for k, number in enumerate(order):
        place = (0.0, -k * apart_m, 500.0)
        speed_mps = round(slowest + k * faster_mps, 2)
        out.append(Course(place, math.pi / 2, speed_mps, 0.0, 220.0).uav(number))
    return _in_order(out)


def _meeting(
    rng: random.Random, heading_rad: float, angle_rad: float, loss_s: float
) -> tuple[Course, Course]:
    """Two straight and level courses at whose reference time the second enters the first's zone."""
    while True:
        speeds = [round(rng.uniform(12.0, 40.0), 1) for _ in range(2)]
        headings = (heading_rad, heading_rad + angle_rad)
        north, east = (
            speeds[1] * part(headings[1]) - speeds[0] * part(headings[0])
            for part in (math.cos, math.sin)
        )
        closing = math.hypot(north, east)
        if closing > 2.0:
            break
    aside_m = rng.uniform(-0.95, 0.95) * REQUIRED_M
    back_m = math.sqrt(REQUIRED_M**2 - aside_m**2)
    altitude_m = rng.uniform(400.0, 700.0)
    above_m = rng.uniform(-0.9, 0.9) * REQUIRED_VERTICAL_M
    place = (
        (-back_m * north - aside_m * east) / closing,
        (-back_m * east + aside_m * north) / closing,
        altitude_m + above_m,
    )
    places = ((0.0, 0.0, altitude_m), place)
    after = [rng.uniform(60.0, 90.0) for _ in range(2)]
    one, two = (
        Course(p, h, v, loss_s, a)
        for p, h, v, a in zip(places, headings, speeds, after, strict=True)
    )
    return one, two


def _varied(rng: random.Random, course: Course) -> Course:
    """The course with a climb or descent in two of five cases, and a bend in one of four.

    Bends lie after the meeting, or so long before it that it is seen in time.
    """
    if rng.random() < 0.4:
        level_after_s = rng.uniform(-20.0, 50.0)
        course = replace(course, climb=rng.choice((-1, 1)), level_after_s=level_after_s)
    if rng.random() < 0.25:
        turn_rad = rng.choice((-1.0, 1.0)) * math.radians(rng.uniform(20.0, 120.0))
        early_s, soon_s = -rng.uniform(46.0, 50.0), rng.uniform(10.0, 45.0)
        when_s = early_s if course.before_s > 60.0 and rng.random() < 0.5 else soon_s
        course = replace(course, bend=Bend(when_s, turn_rad))
    return course


def _stepping(rng: random.Random, course: Course) -> Course:
    """Level until 8 to 30 s before, then climbing or descending into the other's zone."""
    climb = rng.choice((-1, 1))
    north, east, altitude_m = course.place
    inwards = rng.uniform(0.2, 1.0)
    return replace(
        course,
        place=(north * inwards, east * inwards, altitude_m),
        bend=Bend(_corner_s(rng, course), 0.0),
        climb=climb,
        level_after_s=rng.uniform(5.0, 40.0),
        step=True,
    )


def _corner_s(rng: random.Random, course: Course) -> float:
    """A place for a waypoint that is reached, with its radius, 8 to 30 s before."""
    return min(-rng.uniform(*LATE_S) + ARRIVAL_M / course.speed_mps, -1.0)


def _is_late(uavs: tuple[Uav, ...], kind: str) -> bool:
    """Whether the loss comes 8 to 30 s after the last bend before it (or the start), unforeseen."""
    paths = [path_of(u, PLAIN, 120.0) for u in uavs]
    loss_s = _first_loss_s(paths)
    if kind == "start":
        return LATE_S[0] <= loss_s <= LATE_S[1]
    bend_s = next(p.reached_s[0] for u, p in zip(uavs, paths, strict=True) if _bends(u))
    if not LATE_S[0] <= loss_s - bend_s <= LATE_S[1]:
        return False
    straight = [msgspec.structs.replace(u, waypoints_ned_m=u.waypoints_ned_m[:1]) for u in uavs]
    ahead = [path_of(u, PLAIN, bend_s + 60.0) for u in straight]
    return math.isinf(_first_loss_s(ahead))


def _bends(uav: Uav) -> bool:
    return len(uav.waypoints_ned_m) > 1


def _first_loss_s(paths: Sequence[Path]) -> float:
    return min(first_loss_s(a, b, PLAIN.required()) for a, b in combinations(paths, 2))


def _in_order(uavs: Sequence[Uav]) -> tuple[Uav, ...]:
    return tuple(sorted(uavs, key=lambda u: u.id))


@dataclass(frozen=True)
class EncounterSet:
    """A generator and how many of its seeds are flown."""

    uavs: Callable[[int], tuple[Uav, ...]]
    count: int


SETS = {
    "pairs": EncounterSet(pairs, 400),
    "converging": EncounterSet(converging, 60),
    "circle8": EncounterSet(circle(8), 4),
    "circle16": EncounterSet(circle(16), 4),
    "matrix8": EncounterSet(matrix(8), 4),
    "matrix16": EncounterSet(matrix(16), 4),
    "takeover4": EncounterSet(takeover(4), 4),
    "takeover8": EncounterSet(takeover(8), 4),
    "overtake": EncounterSet(overtake, 12),
    "late": EncounterSet(late, 60),
}
