"""Conflict detection finds the pairs, and the times, that samples of every pair find."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.model.conflict import detection
from fleet.model.conflict.boxes import FEW
from fleet.model.conflict.detection import conflicts, released, trajectories
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required, first_overlap_s, sample_times
from fleet.model.conflict.tracks import ActiveManoeuvre, StateReport
from fleet.model.types import Pair
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent, NextCourse

NOW_NS = 7_000_000_000
MODELS = Scenario("detection", 100.0).models()
OUTLOOK = Outlook(MODELS, sample_times(40.0, 1.0), Required(402.0, 51.0))


def by_all_samples(reports: list[StateReport], outlook: Outlook) -> dict[Pair, float]:
    """Every way of each against every way of every other, sample by sample."""
    ways = [trajectories(reports, NOW_NS, outlook), released(reports, NOW_NS, outlook)]
    found: dict[Pair, float] = {}
    for i, one in enumerate(reports):
        for j in range(i + 1, len(reports)):
            relative = np.stack([a[i] - b[j] for a in ways for b in ways])
            first = float(first_overlap_s(relative, outlook.times_s, outlook.required).min())
            if math.isfinite(first):
                found[one.id, reports[j].id] = first
    return found


def craft(uav: int, rng: random.Random, side_m: float, *, plain: bool) -> StateReport:
    """A UAV somewhere; a third of those that are not `plain` turn, climb, bend or change speed."""
    place = (rng.uniform(-side_m, side_m), rng.uniform(-side_m, side_m), rng.uniform(-360, -240))
    heading, speed = rng.uniform(-math.pi, math.pi), rng.uniform(12.0, 40.0)
    guidance = Intent(heading, 0.0, place[2], None, speed)
    manoeuvre = None
    climb = 0.0
    kind = "straight" if plain else rng.choice(["straight"] * 10 + KINDS)
    if kind == "turn":
        manoeuvre = ActiveManoeuvre("turn", rng.uniform(-math.pi, math.pi), 0.0)
    elif kind == "climb":
        manoeuvre = ActiveManoeuvre("climb", heading, rng.uniform(-4.0, 4.0), place[2] - 30.0)
    elif kind == "bend":
        then = NextCourse(rng.uniform(0.0, 90.0), rng.uniform(-math.pi, math.pi), 0.0, place[2])
        guidance = Intent(heading, 0.0, place[2], then, speed)
    elif kind == "levels":
        climb, guidance = 0.1, Intent(heading, 3.0, place[2] - 60.0, None, speed)
    elif kind == "speed":
        manoeuvre = ActiveManoeuvre("speed", heading, 0.0, speed_mps=1.2 * speed)
    state = State(*place, speed, heading, climb)
    t_ns = NOW_NS - round(rng.uniform(0.0, 3.0) * 1e9)
    return StateReport(uav, t_ns, state, guidance, FlightPlan((place,), heading), manoeuvre)


KINDS = ["turn", "climb", "bend", "levels", "speed"]


def scene(seed: int, count: int, side_m: float, *, plain: bool = False) -> list[StateReport]:
    rng = random.Random(seed)
    return [craft(uav, rng, side_m, plain=plain) for uav in range(1, count + 1)]


@pytest.mark.parametrize("seed", range(100))
def test_the_pairs_are_those_of_brute_force(seed: int) -> None:
    """A hundred random scenes: few in a small place, and many enough for the grid."""
    few = seed % 4
    reports = scene(
        seed,
        (9, 14, 11)[few - 1] if few else FEW + 16,
        1500.0 if few else 4000.0,
        plain=seed % 5 == 0,
    )
    wanted = by_all_samples(reports, OUTLOOK)
    assert wanted
    found = conflicts(reports, NOW_NS, OUTLOOK)
    assert found == pytest.approx(wanted, abs=1e-6)
    assert list(found) == sorted(found)


def test_the_scenes_have_pairs_of_every_kind() -> None:
    """Or the comparison would show nothing: both straight, one of them, and none."""
    kinds = set()
    for seed in range(20):
        reports = {r.id: r for r in scene(seed, 14, 1500.0)}
        for pair in conflicts(list(reports.values()), NOW_NS, OUTLOOK):
            kinds.add(sum(reports[uav].manoeuvre is None for uav in pair))
    assert kinds == {0, 1, 2}


def test_who_flies_straight_on_is_not_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    sampled: list[int] = []
    plainly = detection.trajectories

    def seen(reports: list[StateReport], now_ns: int, outlook: Outlook) -> np.ndarray:
        sampled.extend(r.id for r in reports)
        return plainly(reports, now_ns, outlook)

    monkeypatch.setattr(detection, "trajectories", seen)
    assert conflicts(scene(1, 100, 4000.0, plain=True), NOW_NS, OUTLOOK)
    assert sampled == []
    conflicts(scene(1, 100, 12000.0), NOW_NS, OUTLOOK)
    assert 0 < len(sampled) < 100


def test_many_pairs_are_compared_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    reports = scene(2, 14, 1500.0)
    at_once = conflicts(reports, NOW_NS, OUTLOOK)
    monkeypatch.setattr(detection, "AT_ONCE", 3)
    assert conflicts(reports, NOW_NS, OUTLOOK) == at_once


def test_a_model_that_does_not_say_who_flies_straight_is_sampled_throughout() -> None:
    scenario = read_scenario("crossing", ["generate.count=30", "seed=3"]).scenario
    outlook = scenario.outlook()
    reports = [
        StateReport(u.id, NOW_NS, s := u.state(), Intent(s.heading_rad, 0.0), u.plan())
        for u in uavs_of(scenario)
    ]
    in_closed_form = conflicts(reports, NOW_NS, outlook)

    class Silent(type(outlook.models)):  # type: ignore[misc]
        def straight(self, uavs: list[int], _course: object) -> np.ndarray:
            return np.zeros(len(uavs), dtype=np.bool_)

    silent = Silent(outlook.models.of(0))
    sampled = conflicts(reports, NOW_NS, Outlook(silent, outlook.times_s, outlook.required))
    assert in_closed_form
    assert sampled == pytest.approx(in_closed_form, abs=1e-6)
