"""Clock and navigation faults: what a participant reads and senses instead of the truth."""

from __future__ import annotations

import math
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.faults.clock import LocalClock
from fleet.faults.kinds.clock import ClockError
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.navigation import Navigation
from fleet.faults.rules import Rule
from fleet.faults.sensors import Sensors
from fleet.model.vehicle.flight import State
from tests.support.fault_samples import MANY, TICK_NS, fast

S = 1_000_000_000
TRUE = State(100.0, -200.0, -300.0, 25.0, 0.5, 0.1)


def sensors(*plan: Rule, uav: int = 1, seed: int = 1) -> Sensors:
    return Sensors(plan, seed, uav)


def errors(found: Sensors, count: int = MANY) -> np.ndarray:
    """Position minus truth, shape (count, 3)."""
    sensed = [found.sense(TRUE, n * TICK_NS) for n in range(count)]
    return np.array([s.position_ned_m for s in sensed if s]) - TRUE.position_ned_m


# clock


@given(st.floats(-3600.0, 3600.0), st.floats(-1e5, 1e5), st.integers(0, 86_400 * S))
@fast
def test_a_clock_is_off_by_offset_and_drift_from_the_start(
    offset_s: float, drift_ppm: float, now_ns: int
) -> None:
    clock = LocalClock(
        [ClockError(node="1", offset_s=offset_s, drift_ppm=drift_ppm, start_s=10.0)], 1
    )
    exact_s = offset_s + drift_ppm * 1e-6 * (now_ns / 1e9 - 10.0)
    expected = exact_s if now_ns >= 10 * S else 0.0
    assert clock.shift_ns(now_ns) / 1e9 == pytest.approx(expected, abs=2e-9, rel=1e-12)


def test_clock_rules_add_up_for_those_whom_they_name_while_they_last() -> None:
    plan = [
        ClockError(node="2-3", offset_s=0.5),
        Loss(probability=0.1),
        ClockError(node="coordinator,3", offset_s=-2.0, start_s=10.0, end_s=20.0),
    ]
    readings = {n: [LocalClock(plan, n).shift_ns(t * S) for t in (0, 10, 20)] for n in (0, 1, 2, 3)}
    half = S // 2
    assert readings == {
        0: [0, -2 * S, 0],
        1: [0, 0, 0],
        2: [half] * 3,
        3: [half, half - 2 * S, half],
    }
    assert [LocalClock(plan, n).clean for n in (0, 1, 2)] == [False, True, False]


def test_a_clock_can_go_wrong_and_right_during_a_run() -> None:
    clock = LocalClock([], 1)
    assert (clock.clean, clock.shift_ns(5 * S)) == (True, 0)
    clock.replan([ClockError(node="*", offset_s=1.0, start_s=5.0)])
    assert clock.shift_ns(6 * S) == S
    clock.replan([ClockError(node="*", offset_s=1.0, start_s=5.0, end_s=7.0)])
    assert [clock.shift_ns(t * S) for t in (6, 7)] == [S, 0]


# navigation


def test_without_faults_the_truth_is_sensed() -> None:
    found = sensors(Navigation(node="2", noise_m=9.0), Loss(probability=1.0))
    assert found.clean
    assert found.sense(TRUE, 0) is TRUE
    waiting = sensors(Navigation(node="uav", noise_m=9.0, start_s=5.0))
    assert not waiting.clean
    assert waiting.sense(TRUE, 0) == TRUE != waiting.sense(TRUE, 5 * S)


def test_noise_is_normal_with_its_deviations_and_white() -> None:
    found = errors(sensors(Navigation(node="1", noise_m=10.0, vertical_noise_m=4.0)))
    assert found.std(axis=0) == pytest.approx([10.0, 10.0, 4.0], rel=0.01)
    assert np.abs(found.mean(axis=0)) == pytest.approx([0.0] * 3, abs=10.0 * 3.3 / math.sqrt(MANY))
    for axis, sigma in enumerate((10.0, 10.0, 4.0)):
        for q in (0.05, 0.25, 0.75, 0.95):
            expected = statistics.NormalDist(0.0, sigma).inv_cdf(q)
            assert np.quantile(found[:, axis], q) == pytest.approx(expected, abs=0.02 * sigma)
    together = np.corrcoef(np.concatenate([found[1:], found[:-1]], axis=1), rowvar=False)
    assert np.abs(together - np.eye(6)).max() < 4.0 / math.sqrt(MANY)


def test_noise_of_two_uavs_is_independent_and_that_of_one_repeats() -> None:
    rule = Navigation(node="uav", noise_m=10.0, vertical_noise_m=10.0)
    one, two = (errors(sensors(rule, uav=uav)) for uav in (1, 2))
    together = np.corrcoef(np.concatenate([one, two], axis=1), rowvar=False)
    assert np.abs(together - np.eye(6)).max() < 4.0 / math.sqrt(MANY)
    again, other = (errors(sensors(rule, seed=seed), 100) for seed in (1, 2))
    assert (again == one[:100]).all()
    assert not (other == again).any()


def test_noise_does_not_depend_on_what_was_sensed_before() -> None:
    rule = Navigation(node="uav", noise_m=10.0, velocity_noise_mps=1.0, dropout=0.3)
    forwards, backwards = sensors(rule), sensors(rule)
    there = [forwards.sense(TRUE, n * TICK_NS) for n in range(200)]
    back = [backwards.sense(TRUE, n * TICK_NS) for n in reversed(range(200))]
    assert there == back[::-1]


def test_velocity_noise_is_that_of_each_component() -> None:
    found = sensors(Navigation(node="1", velocity_noise_mps=2.0))
    sensed = [found.sense(TRUE, n * TICK_NS) for n in range(MANY)]
    off = np.array([s.velocity_ned_mps for s in sensed if s]) - TRUE.velocity_ned_mps
    assert off.std(axis=0) == pytest.approx([2.0] * 3, rel=0.01)
    assert np.abs(off.mean(axis=0)).max() < 2.0 * 3.3 / math.sqrt(MANY)
    assert {s.position_ned_m for s in sensed if s} == {TRUE.position_ned_m}


def test_a_uav_never_takes_itself_to_stand_still() -> None:
    found = sensors(Navigation(node="1", velocity_noise_mps=100.0))
    slow = State(0.0, 0.0, 0.0, 1.5, 0.0)
    speeds = [s.speed_mps for n in range(20_000) if (s := found.sense(slow, n * TICK_NS))]
    assert min(speeds) >= 1.0


def test_a_bias_is_constant_and_a_drift_grows_from_the_start() -> None:
    rule = Navigation(
        node="1", bias_ned_m=(1.0, -2.0, 3.0), drift_ned_mps=(0.5, 0.0, -0.25), start_s=10.0
    )
    found = errors(sensors(rule), 201)
    assert (found[:100] == 0.0).all()
    assert found[100] == pytest.approx([1.0, -2.0, 3.0])
    assert found[200] == pytest.approx([1.0 + 5.0, -2.0, 3.0 - 2.5])


def test_a_frozen_position_is_the_first_one_sensed_in_the_window() -> None:
    found = sensors(Navigation(node="1", noise_m=5.0, freeze=True, start_s=1.0, end_s=3.0))
    sensed = [found.sense(State(25.0 * n, 0.0, 0.0, 25.0, 0.1 * n), n * TICK_NS) for n in range(40)]
    norths = [s.north_m for s in sensed if s]
    assert len(set(norths[10:30])) == 1
    assert 0.0 < abs(norths[10] - 250.0) < 25.0
    assert norths[30:] == [25.0 * n for n in range(30, 40)]
    assert [s.heading_rad for s in sensed if s] == [0.1 * n for n in range(40)]


def test_dropouts_are_as_many_as_said() -> None:
    found = sensors(Navigation(node="1", dropout=0.2))
    missing = sum(found.sense(TRUE, n * TICK_NS) is None for n in range(MANY)) / MANY
    assert missing == pytest.approx(0.2, abs=2.576 * math.sqrt(0.16 / MANY))
    assert sensors(Navigation(node="1", dropout=1.0)).sense(TRUE, 0) is None


def test_sensors_can_fail_and_recover_during_a_run_and_keep_what_is_frozen() -> None:
    found = sensors()
    frozen = Navigation(node="1", freeze=True)
    found.replan([frozen])
    assert found.sense(TRUE, 0) == TRUE
    moved = State(999.0, 0.0, 0.0, 25.0, 0.0)
    found.replan([frozen, Navigation(node="1", bias_ned_m=(1.0, 0.0, 0.0))])
    sensed = found.sense(moved, S)
    assert sensed is not None
    assert sensed.position_ned_m == (101.0, -200.0, -300.0)
    found.replan([Navigation(node="1", freeze=True, end_s=2.0)])
    assert found.sense(moved, 2 * S) == moved
