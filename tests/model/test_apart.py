"""Corridors hold what samples show, and who is taken to be apart is so by samples."""

from __future__ import annotations

import math
import random
from collections import Counter
from itertools import combinations

import numpy as np
import pytest

from fleet.model.conflict import detection
from fleet.model.conflict.apart import in_doubt, level_near_s
from fleet.model.conflict.detection import conflicts, released, trajectories
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required
from fleet.model.conflict.tracks import StateReport
from fleet.model.units import to_s
from fleet.model.vehicle.corridors import Corridor
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent, NextCourse
from tests.model.test_detection import MODELS, NOW_NS, OUTLOOK, by_all_samples, craft

HORIZON_S = OUTLOOK.horizon_s
ALLOWED_M = 1e-6


def kind_of(report: StateReport) -> str:
    if report.manoeuvre is not None:
        return report.manoeuvre.manoeuvre
    return "bend" if report.guidance.bends else "guided"


def turning(uav: int, rng: random.Random) -> StateReport:
    """A UAV as in `test_detection`, on its way to another heading and altitude."""
    own = craft(uav, rng, 3000.0, plain=False)
    heading, climb = rng.uniform(-math.pi, math.pi), rng.choice([0.0, rng.uniform(-5.0, 5.0)])
    level = rng.choice([own.state.down_m, own.state.down_m + rng.uniform(-80.0, 80.0), math.nan])
    path = rng.choice([0.0, rng.uniform(-0.25, 0.25)])
    state = State(*own.state.position_ned_m, own.state.speed_mps, heading, path)
    guidance = Intent(
        own.guidance.heading_rad, climb, level, own.guidance.then, own.guidance.speed_mps
    )
    return StateReport(own.id, own.t_ns, state, guidance, own.plan, own.manoeuvre)


def outside_m(corridor: Corridor, path: np.ndarray) -> float:
    """By how much a sampled path (n, 3) leaves a corridor while that holds."""
    times = OUTLOOK.times_s
    held = times <= corridor.until_s
    north = corridor.north_m + times * corridor.to_north_mps - path[:, 0]
    east = corridor.east_m + times * corridor.to_east_mps - path[:, 1]
    beside = np.hypot(north, east) - corridor.stray_m
    over = np.maximum(corridor.low_m - path[:, 2], path[:, 2] - corridor.high_m)
    return float(np.maximum(beside, over)[held].max(initial=-math.inf))


def test_corridors_hold_what_is_flown_and_what_would_be_flown() -> None:
    rng, known = random.Random(5), Counter[str]()
    for _ in range(3000):
        report = rng.choice([turning(1, rng), craft(1, rng, 3000.0, plain=False)])
        age_s = to_s(NOW_NS - report.t_ns)
        told = (report.state, report.guidance, age_s, HORIZON_S)
        held = age_s if report.manoeuvre else 0.0
        flown = MODELS.of(1).corridor(report.state, report.intent(), age_s, HORIZON_S)
        guided = MODELS.of(1).corridor(*told, otherwise_s=held)
        paths = trajectories([report], NOW_NS, OUTLOOK)[0], released([report], NOW_NS, OUTLOOK)[0]
        for corridor, path in ((flown, paths[0]), (guided, paths[1])):
            if corridor is not None:
                known[kind_of(report)] += 1
                assert outside_m(corridor, path) < ALLOWED_M, report
    assert min(known[kind] for kind in ("guided", "bend", "turn", "climb")) > 100


def test_a_straight_flight_has_a_corridor_without_width() -> None:
    report = craft(1, random.Random(1), 3000.0, plain=True)
    corridor = MODELS.of(1).corridor(report.state, report.guidance, 0.0, HORIZON_S)
    assert corridor is not None
    assert (corridor.stray_m, corridor.until_s) == (0.0, math.inf)
    assert corridor.low_m == corridor.high_m == report.state.down_m


def test_a_turn_strays_by_more_than_its_arc_does() -> None:
    """A quarter of a circle of radius r ends (1, 1) r from its start, on the line r pi / 2."""
    rng = random.Random(1)
    own = craft(1, rng, 3000.0, plain=True)
    speed, heading = own.state.speed_mps, own.state.heading_rad
    radius_m = MODELS.of(1).limits.turn_radius_m(speed)
    intent = Intent(heading + math.pi / 2, 0.0, own.state.down_m)
    corridor = MODELS.of(1).corridor(own.state, intent, 0.0, HORIZON_S)
    assert corridor is not None
    assert corridor.stray_m > radius_m * math.hypot(1.0, math.pi / 2 - 1.0)


@pytest.mark.parametrize("seed", range(300))
def test_who_is_taken_to_be_apart_is_apart(seed: int) -> None:
    rng = random.Random(seed)
    side_m, make = rng.choice([1000.0, 2500.0, 5000.0]), rng.random()
    reports = [
        turning(uav, rng) if rng.random() < make else craft(uav, rng, side_m, plain=False)
        for uav in range(1, rng.choice([3, 4, 6]))
    ]
    if apart(reports, OUTLOOK):
        assert by_all_samples(reports, OUTLOOK) == {}


def apart(reports: list[StateReport], outlook: Outlook) -> bool:
    return not in_doubt(reports, list(combinations(range(len(reports)), 2)), NOW_NS, outlook)


def test_many_are_taken_to_be_apart_and_the_rest_is_sampled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sampled = 0

    def seen(*given: object) -> object:
        nonlocal sampled
        sampled += 1
        return plainly(*given)  # type: ignore[arg-type]

    plainly = detection._straight_ways
    monkeypatch.setattr(detection, "_straight_ways", seen)
    rng = random.Random(1)
    scenes = [[craft(u, rng, 3000.0, plain=False) for u in (1, 2)] for _ in range(200)]
    wanted = [bool(by_all_samples(reports, OUTLOOK)) for reports in scenes]
    assert [bool(conflicts(reports, NOW_NS, OUTLOOK)) for reports in scenes] == wanted
    assert 0 < sum(wanted) <= sampled < 100


def test_what_comes_after_a_bend_is_not_taken_for_straight() -> None:
    """They would pass 700 m apart, but one turns off to the east, before the other, after 20 s."""
    then = NextCourse(20.0, math.pi / 2, 0.0, -300.0)
    bent = Intent(0.0, 0.0, -300.0, then, 30.0)
    pair = [
        on_course(1, State(0.0, 0.0, -300.0, 30.0, 0.0), bent),
        on_course(2, State(2000.0, 700.0, -300.0, 30.0, math.pi), Intent(math.pi, 0.0, -300.0)),
    ]
    assert not apart(pair, OUTLOOK)
    assert list(conflicts(pair, NOW_NS, OUTLOOK)) == [(1, 2)]
    passing = [on_course(1, pair[0].state, Intent(0.0, 0.0, -300.0)), pair[1]]
    assert apart(passing, OUTLOOK)


def on_course(uav: int, state: State, guidance: Intent) -> StateReport:
    plan = FlightPlan((state.position_ned_m,), state.heading_rad)
    return StateReport(uav, NOW_NS, state, guidance, plan)


def test_until_two_ways_come_near_in_the_plane_whatever_their_altitudes() -> None:
    """1000 m nose to nose at 25 m/s each: 597 m until 402 m and 1 m for rounding are left."""
    required = Required(402.0, 51.0)

    def way(north_m: float, to_north_mps: float, east_m: float = 0.0) -> Corridor:
        return Corridor(north_m, east_m, to_north_mps, 0.0, 0.0, -300.0, -300.0, 25.0)

    mine = way(0.0, 25.0)
    assert level_near_s(mine, way(1000.0, -25.0), required) == pytest.approx(597.0 / 50.0)
    assert level_near_s(mine, way(400.0, -25.0), required) == 0.0
    assert level_near_s(mine, way(-1000.0, -25.0), required) == math.inf
    assert level_near_s(mine, way(1000.0, -25.0, 404.0), required) == math.inf
