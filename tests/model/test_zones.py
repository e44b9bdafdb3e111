"""UAVs with protected zones of their own: a pair requires the sums of both (eq. 8)."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from fleet.analysis.separation import SeparationMonitor
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Growth, Required, normalised_separation, sample_times
from fleet.model.conflict.watch import ConflictWatch
from fleet.model.conflict.zones import ALL_ALIKE, ZoneRatios
from fleet.model.types import Pair
from tests.model.test_detection import MODELS, NOW_NS, craft, scene

LEAST = Required(200.0, 30.0)
ZONES = ZoneRatios({2: (3.0, 1.0), 3: (1.5, 2.0), 5: (1.0, 4.0)})
RADII_M = {1: 100.0, 2: 300.0, 3: 150.0, 4: 100.0, 5: 100.0}
HALF_HEIGHTS_M = {1: 15.0, 2: 15.0, 3: 30.0, 4: 15.0, 5: 60.0}
TIMES_S = sample_times(40.0, 1.0)
OUTLOOK = Outlook(MODELS, TIMES_S, LEAST, ZONES)


def sums(one: int, other: int) -> Required:
    return Required(RADII_M[one] + RADII_M[other], HALF_HEIGHTS_M[one] + HALF_HEIGHTS_M[other])


PAIRS = [(i, j) for i in RADII_M for j in RADII_M if i < j]


def test_a_pair_requires_the_sums_of_the_sizes_of_its_zones() -> None:
    for pair in PAIRS:
        told, wanted = ZONES.of_pair(pair, LEAST), sums(*pair)
        assert told.horizontal_m == pytest.approx(wanted.horizontal_m, rel=1e-15)
        assert told.vertical_m == pytest.approx(wanted.vertical_m, rel=1e-15)
    greatest = ZONES.greatest(LEAST)
    assert (greatest.horizontal_m, greatest.vertical_m) == pytest.approx((600.0, 120.0))


def test_scaled_positions_are_as_far_from_the_least_as_positions_from_what_is_required() -> None:
    growth, ages_s = Growth(5.0, 1.0), np.linspace(0.0, 9.0, len(PAIRS))
    relative = np.random.default_rng(1).normal(0.0, (300.0, 300.0, 40.0), (len(PAIRS), 7, 3))
    for grows, more in ((Growth(), 0.0), (growth, 1.0)):
        scale = ZONES.scale(PAIRS, LEAST, grows, ages_s.tolist() if more else (0.0,))
        assert scale is not None
        told = normalised_separation(relative * scale, LEAST)
        for row, pair in enumerate(PAIRS):
            needed, age_s = sums(*pair), more * ages_s[row]
            grown = Required(needed.horizontal_m + 5.0 * age_s, needed.vertical_m + 1.0 * age_s)
            assert told[row] == pytest.approx(normalised_separation(relative[row], grown))


def test_where_all_are_alike_nothing_is_scaled() -> None:
    assert ALL_ALIKE.scale(PAIRS, LEAST) is None
    assert ALL_ALIKE.of_pair((1, 2), LEAST) is LEAST


@pytest.mark.parametrize("seed", range(120))
def test_conflicts_are_those_that_each_pair_has_by_itself(seed: int) -> None:
    """Few UAVs, of which each pair is asked, and many, for the boxes."""
    rng = random.Random(seed)
    if seed % 3:
        reports = scene(seed, 5, rng.choice([600.0, 1500.0, 2500.0]), plain=seed % 3 == 1)
        zones = ZONES
    else:
        reports = scene(seed, 30, 3000.0)
        zones = ZoneRatios({uav: (1.0 + uav % 3, 1.0 + uav % 2) for uav in range(1, 31)})
    told = conflicts(reports, NOW_NS, Outlook(MODELS, TIMES_S, LEAST, zones))
    wanted: dict[Pair, float] = {}
    for n, one in enumerate(reports):
        for other in reports[n + 1 :]:
            required = zones.of_pair((one.id, other.id), LEAST)
            wanted |= conflicts([one, other], NOW_NS, Outlook(MODELS, TIMES_S, required))
    assert told.keys() == wanted.keys()
    assert list(told.values()) == pytest.approx([wanted[pair] for pair in told], abs=1e-6)


def test_the_watch_remembers_only_pairs_that_are_deep_in_their_own_zones() -> None:
    found = 0
    for seed in range(60):
        rng = random.Random(seed)
        reports = [craft(uav, rng, 900.0, plain=False) for uav in RADII_M]
        watch = ConflictWatch(OUTLOOK)
        for later_ns in range(0, 8_000_000_000, 1_000_000_000):
            wanted = conflicts(reports, NOW_NS + later_ns, OUTLOOK)
            assert list(watch.at_risk(reports, NOW_NS + later_ns)) == sorted(wanted)
            found += len(wanted)
    assert found > 100


def test_separation_is_measured_by_what_each_pair_requires() -> None:
    ids = list(RADII_M)
    monitor, rng = SeparationMonitor(ids, LEAST, ZONES), np.random.default_rng(3)
    start, step = rng.normal(0.0, (900.0, 900.0, 60.0), (5, 3)), rng.normal(0.0, 40.0, (5, 3))
    fine = np.linspace(0.0, 50.0, 50_001)
    for second in range(51):
        monitor.update(second * 1_000_000_000, start + second * step)
    for minimum in monitor.minima():
        i, j = ids.index(minimum.a), ids.index(minimum.b)
        relative = start[i] - start[j] + fine[:, None] * (step[i] - step[j])
        level = np.hypot(relative[:, 0], relative[:, 1])
        needed = sums(*minimum.pair)
        apart = np.maximum(level / needed.horizontal_m, abs(relative[:, 2]) / needed.vertical_m)
        assert minimum.least_separation == pytest.approx(apart.min(), abs=5e-4)
        at = int(np.argmin(abs(fine - minimum.t_s)))
        assert minimum.horizontal_m == pytest.approx(level[at], abs=0.2)
        assert math.isclose(minimum.vertical_m, abs(relative[at, 2]), abs_tol=0.2)
