"""Who arrives, when, how late, and who is back on its plan: from runs and by hand."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import numpy as np
import pytest

from fleet.analysis.arrival import Arrival, ArrivalMonitor, Arrivals
from fleet.analysis.planned import STRAIGHT_RAD, Planned, Plans, deviations, planned_flight
from fleet.analysis.words import arrival_text
from fleet.config.loading import convert, read_scenario
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.pause import Pause
from fleet.faults.rules import Rule
from fleet.fuzz.cases import case_of
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan, Pilot
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from tests.support import samples

ROW = Arrival(1, "flown", True, 30.0, 20.0, True, 10.0, True, None)


def alone(duration_s: float = 30.0, *plan: Rule, **changes: Any) -> Scenario:
    """One UAV at 25 m/s that is to fly 600 m north: within 100 m of its waypoint after 20 s."""
    uav = Uav(1, (0.0, 0.0, -300.0), 0.0, ((600.0, 0.0, -300.0),))
    return Scenario("alone", duration_s, fault=plan, **{"uav": (uav,), **changes})


def flown(scenario: Scenario) -> Arrivals:
    """What has come of a run."""
    run_recorder = RunRecorder(scenario, None, digested=False)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return run_recorder.arrivals.arrivals()


def test_who_is_not_disturbed_arrives_as_planned() -> None:
    found = flown(alone())
    (row,) = found.rows
    assert row == Arrival(1, "flown", True, 20.0, 20.0, True, 0.0, True, None)
    assert planned_flight(alone().uav[0], alone()).arrival_ns == 20_000_000_000
    assert (found.all_arrived, found.missing) == ("yes", [])


@pytest.mark.parametrize("name", ["four_way", "crossing", "case"])
def test_a_plan_that_is_flown_to_its_end_is_not_flown_on(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = convert(case_of(2), "case") if name == "case" else read_scenario(name).scenario
    scenario = msgspec.structs.replace(loaded, duration_s=600.0)
    for uav in uavs_of(scenario)[:3]:
        short = planned_flight(uav, scenario)
        with monkeypatch.context() as patch:
            patch.setattr("fleet.analysis.planned._settled", lambda *_: False)
            whole = planned_flight(uav, scenario)
        assert short.arrival_ns == whole.arrival_ns
        path_m, altitude_m = deviations(short.corners, whole.corners)
        assert max(path_m.max(), altitude_m.max()) < 2e5 * STRAIGHT_RAD


def test_a_day_of_flight_after_the_last_waypoint_takes_no_time() -> None:
    steps: list[State] = []
    day = alone(86_400.0)
    pilot = day.pilot(1, 25.0)

    class Counting(Pilot):
        def follow(
            self, plan: FlightPlan, state: State, span_ns: int
        ) -> tuple[FlightPlan, list[State]]:
            steps.append(state)
            return pilot.follow(plan, state, span_ns)

    with pytest.MonkeyPatch.context() as patch:
        counting = Counting(pilot.settings, pilot.model)
        patch.setattr(Scenario, "pilot", lambda *_: counting)
        assert planned_flight(day.uav[0], day).arrival_ns == 20_000_000_000
    assert len(steps) < 300


def test_a_plan_is_flown_as_far_as_the_record_goes_and_on(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int | None] = []

    def flying(uav: Uav, scenario: Scenario, ticks: int | None = None) -> Planned:
        asked.append(ticks)
        return planned_flight(uav, scenario, ticks)

    monkeypatch.setattr("fleet.analysis.planned.planned_flight", flying)
    (uav,) = alone().uav
    far = msgspec.structs.replace(uav, waypoints_ned_m=((30_000.0, 500.0, -300.0),))
    scenario = alone(1_300.0, uav=(far,))
    plans = Plans(scenario)
    begun = [plans.of(far, n) for n in (0, 1, 2_000)]
    assert {(flight.ticks, flight.arrival_ns) for flight in begun} == {(4_000, None)}
    assert plans.of(far, 2_001).ticks == 8_000
    whole, again = plans.of(far, 12_000), plans.of(far, 13_000)
    assert again is whole
    assert asked == [4_000, 8_000, 16_000]
    # What has been flown before is of the same path, and goes on straight beyond.
    straight = planned_flight(far, scenario)
    assert whole.arrival_ns == straight.arrival_ns is not None
    assert np.array_equal(whole.corners, straight.corners)
    assert deviations(begun[0].corners, straight.corners[:-2])[0].max() < 1e-6


def test_who_would_not_arrive_before_the_end_is_not_due() -> None:
    found = flown(alone(19.0))
    (row,) = found.rows
    assert (row.arrived, row.planned_arrival_s, row.due) == (False, None, False)
    assert found.all_arrived == "not due"


def test_an_unmanned_aircraft_is_not_expected_and_one_that_was_held_is() -> None:
    (killed,) = flown(alone(30.0, Kill(node="1", start_s=5.0))).rows
    assert (killed.aircraft, killed.arrived, killed.planned_arrival_s) == ("unmanned", False, 20.0)
    assert not killed.due
    (gone,) = flown(alone(30.0, Kill(node="1", start_s=5.0, then="vanish"), uav=pair())).rows[:1]
    assert (gone.aircraft, gone.due) == ("vanished", False)
    (held,) = flown(alone(30.0, Pause(node="1", start_s=5.0, end_s=8.0))).rows
    assert (held.aircraft, held.arrival_s, held.due) == ("flown", 20.0, True)


def pair() -> tuple[Uav, ...]:
    """The same UAV, and one far away."""
    (uav,) = alone().uav
    return uav, Uav(2, (0.0, 50_000.0, -300.0), 0.0, ((600.0, 50_000.0, -300.0),))


def test_a_detour_is_late_and_comes_back() -> None:
    # Driven 200 m to the side and back by hand: off from 50 m on, back on the plan at 9 s.
    monitor = ArrivalMonitor(alone(40.0))
    sides = [0.0, 10.0, 50.0, 200.0, 200.0, 100.0, 50.0, 30.0, 26.0, 24.0, 0.0]
    for second in range(36):
        side_m = sides[second] if second < len(sides) else 0.0
        truth = samples.truth(1, (16.0 * second, side_m, -300.0), second * 1_000_000_000)
        mode = "turn" if 1 <= second < 6 else "plan"
        index = int(600.0 - 16.0 * second <= 100.0)
        monitor.add(msgspec.structs.replace(truth, mode=mode, waypoint_index=index))
    (row,) = monitor.arrivals().rows
    assert (row.arrival_s, row.planned_arrival_s, row.delay_s) == (32.0, 20.0, 12.0)
    assert (row.back_on_plan, row.back_on_plan_s) == (True, 9.0)


@pytest.mark.parametrize(
    ("rows", "all_arrived", "missing"),
    [
        ([{}, {}], "yes", []),
        ([{}, {"arrived": False}], "no", [2]),
        ([{}, {"arrived": False, "due": False}], "not due", []),
        ([{}, {"arrived": False, "due": False, "aircraft": "unmanned"}], "yes", []),
        ([{"arrived": False}, {"arrived": False, "due": False}], "no", [1]),
        ([{"arrived": False, "due": False, "aircraft": "unmanned"}], "not due", []),
        ([], "not due", []),
    ],
)
def test_all_arrived(rows: list[dict[str, Any]], all_arrived: str, missing: list[int]) -> None:
    made = [dataclasses.replace(ROW, id=n + 1, **changes) for n, changes in enumerate(rows)]
    found = Arrivals(tuple(made))
    assert (found.all_arrived, found.missing) == (all_arrived, missing)


def test_arrivals_in_words() -> None:
    late = dataclasses.replace(ROW, id=3, arrived=False, delay_s=None)
    told = Arrivals((ROW, dataclasses.replace(ROW, id=2, delay_s=0.0), late)).totals()
    text = "no: 2 of 3; UAV 3 was due and did not arrive; delay mean 5.0 s, max 10.0 s"
    assert arrival_text(told, 3) == text


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        ([{}, {}], "yes: 2 of 2"),
        (
            [{}, {"arrived": False, "due": False}],
            "not yet: 1 of 2; no other was due by the end",
        ),
        (
            [{"arrived": False, "due": False}],
            "not yet: 0 of 1; none was due by the end",
        ),
        (
            [{}, {"arrived": False, "due": False, "aircraft": "unmanned"}],
            "yes: 1 of 2; the others are not flown to the end",
        ),
        (
            [{"arrived": False}, {"arrived": False}],
            "no: 0 of 2; UAV 1, 2 were due and did not arrive",
        ),
        (
            [{"arrived": False}, {"arrived": False, "due": False}],
            "no: 0 of 2; UAV 1 was due and did not arrive",
        ),
    ],
)
def test_who_is_missing_is_said_plainly(rows: list[dict[str, Any]], text: str) -> None:
    made = [dataclasses.replace(ROW, id=n + 1, delay_s=None, **row) for n, row in enumerate(rows)]
    assert arrival_text(Arrivals(tuple(made)).totals(), len(rows)) == text
