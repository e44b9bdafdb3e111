"""Encounters: what is drawn is where and when it is said to be, and the same in every cell."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.loading import load_scenario
from fleet.config.scenario import Uav
from fleet.errors import StudyError
from fleet.study.encounters.as_planned import AsPlanned
from fleet.study.encounters.converging import Converging
from fleet.study.encounters.encounter_kind import EncounterKind, dice_of, fault_seed
from fleet.study.encounters.overtaking import Overtaking
from fleet.study.encounters.pairs import Near, Pairs
from fleet.study.encounters.scenario_files import ScenarioFiles
from fleet.study.encounters.traffic import RandomTraffic
from fleet.study.loading import load_study
from fleet.study.unavoided import planned_path

BASE = load_scenario("head_on")
KINDS = (
    AsPlanned(across_m=100.0, heading_deg=5.0),
    Pairs(),
    Overtaking(),
    Converging(count=(2, 6)),
    RandomTraffic(),
    ScenarioFiles(("head_on", "side")),
)


def straight(uav: Uav, times_s: np.ndarray) -> np.ndarray:
    """Where a UAV is if it flies straight and level on its heading: shape (times, 3)."""
    heading = math.radians(uav.heading_deg)
    velocity = uav.speed_mps * np.array([math.cos(heading), math.sin(heading), 0.0])
    return np.array(uav.position_ned_m) + times_s[:, None] * velocity


def nearest(uavs: Sequence[Uav], until_s: float = 120.0) -> tuple[float, float, float]:
    """When two that fly straight and level are nearest horizontally, and how far apart then."""
    times_s = np.linspace(0.0, until_s, 12_001)
    apart = straight(uavs[0], times_s) - straight(uavs[1], times_s)
    distance = np.linalg.norm(apart[:, :2], axis=1)
    row = int(np.argmin(distance))
    return float(times_s[row]), float(distance[row]), float(abs(apart[row, 2]))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: type(kind).__name__)
def test_an_encounter_is_a_function_of_seed_and_number(kind: EncounterKind) -> None:
    def drawn(seed: int, number: int) -> object:
        return kind.drawn(dice_of(seed, number), number, BASE)

    assert drawn(3, 4) == drawn(3, 4)
    if not isinstance(kind, RandomTraffic):  # which the run's seed places
        assert drawn(3, 4) != drawn(3, 5)
    if not isinstance(kind, RandomTraffic | ScenarioFiles):
        assert drawn(3, 4) != drawn(4, 4)
    assert fault_seed(3, 4) not in {fault_seed(3, 5), fault_seed(4, 4)}


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_pairs_are_nearest_when_and_as_far_as_is_drawn(number: int) -> None:
    kind = Pairs(climbing=0.0, cpa_s=(50.0, 50.0), miss_m=(137.0, 137.0), vertical_m=(21.0, 21.0))
    uavs = kind.drawn(dice_of(0, number), number, BASE).uavs
    at_s, apart_m, above_m = nearest(uavs)
    closing = float(
        np.linalg.norm(
            np.diff(straight(uavs[0], np.arange(2)) - straight(uavs[1], np.arange(2)), axis=0)
        )
    )
    assert at_s == pytest.approx(50.0, abs=0.02 + 10.0 / closing**2)
    assert apart_m == pytest.approx(137.0, abs=0.1)
    assert above_m == pytest.approx(21.0, abs=1e-6)


def test_crossing_angles_speeds_and_misses_are_uniform_within_their_bounds() -> None:
    kind = Pairs(climbing=0.0, angle_deg=(60.0, 120.0), miss_m=(0.0, 300.0), apart_m=0.0)
    angles, misses, speeds = [], [], []
    for number in range(400):
        one, two = kind.drawn(dice_of(1, number), number, BASE).uavs
        angles.append(abs(math.remainder(one.heading_deg - two.heading_deg, 360.0)))
        misses.append(nearest((one, two))[1])
        speeds += [one.speed_mps, two.speed_mps]
    for values, low, high in ((angles, 60, 120), (misses, 0, 300), (speeds, 20, 40)):
        assert low - 0.1 <= min(values)
        assert max(values) <= high + 0.1
        counts, _ = np.histogram(values, 4, (low, high))
        assert counts.min() > 0.7 * len(values) / 4  # 5 standard deviations of a quarter


def test_climbing_pairs_are_as_far_above_each_other_as_is_drawn_when_guidance_flies_them() -> None:
    kind = Pairs(climbing=1.0, vertical_m=(10.0, 10.0), cpa_s=(50.0, 50.0))
    for number in range(10):
        one, two = kind.drawn(dice_of(2, number), number, BASE).uavs
        scenario = msgspec.structs.replace(BASE, duration_s=60.0, uav=(one, two))
        apart = planned_path(one, scenario)[500] - planned_path(two, scenario)[500]
        assert abs(apart[2]) == pytest.approx(10.0, abs=0.5)
        climbed = planned_path(one, scenario)[500][2] - one.position_ned_m[2]
        assert abs(climbed) == pytest.approx(150.0, abs=0.5)  # 50 s at 3 m/s


def test_nobody_starts_near_another() -> None:
    for kind in (Pairs(), Converging(count=(8, 8))):
        for number in range(30):
            uavs = kind.drawn(dice_of(5, number), number, BASE).uavs
            for n, one in enumerate(uavs):
                for two in uavs[:n]:
                    a, b = one.position_ned_m, two.position_ned_m
                    assert math.dist(a[:2], b[:2]) >= 450.0 or abs(a[2] - b[2]) >= 60.0


def test_weights_give_back_what_was_drawn_more_often() -> None:
    """The weighted share of near encounters is that of unweighted draws: 1 in 16 here."""
    plain = Pairs(miss_m=(0.0, 400.0), vertical_m=(0.0, 40.0), climbing=0.0, apart_m=0.0)
    more = msgspec.structs.replace(plain, near=Near(0.6, 100.0, 10.0))
    weights, near = [], []
    for number in range(3000):
        drawn = more.drawn(dice_of(7, number), number, BASE)
        _, apart_m, above_m = nearest(drawn.uavs) if number < 400 else (0.0, 0.0, 0.0)
        weights.append(drawn.weight)
        if number < 400:
            near.append(apart_m <= 100.0 and above_m <= 10.0)
    values = sorted(set(np.round(weights, 9)))
    # Beyond: 1 / 0.4. Within, which is 1 / 16 of all: 1 / (0.4 + 0.6 * 16).
    assert values == pytest.approx([0.1, 2.5])
    assert [w < 1.0 for w in weights[:400]] == near
    assert np.mean(weights) == pytest.approx(1.0, abs=0.1)


def test_overtaking_comes_from_behind_and_faster() -> None:
    for number in range(20):
        uavs = Overtaking().drawn(dice_of(0, number), number, BASE).uavs
        behind, ahead = sorted(uavs, key=lambda u: u.position_ned_m[0])
        assert behind.speed_mps >= ahead.speed_mps + 2.0
        assert 450.0 <= ahead.position_ned_m[0] - behind.position_ned_m[0] <= 700.0


def test_converging_uavs_are_near_the_origin_when_they_meet() -> None:
    kind = Converging(count=(5, 5), meet_s=(60.0, 60.0), spread_m=50.0, vertical_m=5.0)
    uavs = kind.drawn(dice_of(0, 1), 1, BASE).uavs
    assert len(uavs) == 5
    for uav in uavs:
        north, east, _ = straight(uav, np.array([60.0]))[0]
        assert max(abs(north), abs(east)) <= 50.001


def test_scattered_starts_stay_within_their_bounds() -> None:
    kind = AsPlanned(across_m=50.0, along_m=20.0, altitude_m=5.0, heading_deg=2.0)
    before = BASE.uav[0]  # flies east
    for number in range(50):
        after = kind.drawn(dice_of(0, number), number, BASE).uavs[0]
        moved = np.subtract(after.position_ned_m, before.position_ned_m)
        assert (np.abs(moved) <= [50.0, 20.0, 5.0]).all()
        assert abs(after.heading_deg - before.heading_deg) <= 2.0
        assert after.waypoints_ned_m == before.waypoints_ned_m


def test_a_draw_that_cannot_be_made_says_so() -> None:
    with pytest.raises(StudyError, match=r"apart_m"):
        load_study(
            {"name": "x", "encounters": {"kind": "pairs", "apart_m": 1e6, "apart_vertical_m": 1e5}}
        )


@pytest.mark.parametrize(
    ("table", "why"),
    [
        ({"kind": "pairs", "cpa_s": [60, 50]}, "cpa_s: the first is greater"),
        (
            {"kind": "pairs", "near": {"share": 0.5, "miss_m": 900, "vertical_m": 5}},
            "near: outside",
        ),
        ({"kind": "circles"}, "circles"),
        ({"kind": "files", "paths": ["no_such.toml"]}, "no_such.toml"),
    ],
)
def test_encounters_that_cannot_be_are_refused_with_the_reason(
    table: dict[str, object], why: str
) -> None:
    with pytest.raises(StudyError, match=why):
        load_study({"name": "x", "encounters": table})


def test_the_number_of_a_draw_does_not_depend_on_the_global_generator() -> None:
    random.seed(1)
    one = Pairs().drawn(dice_of(0, 0), 0, BASE)
    random.seed(2)
    assert Pairs().drawn(dice_of(0, 0), 0, BASE) == one
