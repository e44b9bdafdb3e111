"""Speed as a manoeuvre: an overtaker waits, or who is overtaken hurries, and all get home."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import msgspec
import pytest

from fleet.agents.advisory import Advisory, Aircraft, Situation
from fleet.agents.geometry import Geometry
from fleet.agents.obedience import Recipient, refusal
from fleet.analysis.invariants import RecordedRun, Verdict, check
from fleet.analysis.metrics import measure
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.scenario import Resolution, Scenario, Uav
from fleet.export.lines import manoeuvre_text
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.pause import Pause
from fleet.model.conflict.tracks import ActiveManoeuvre, intent_of
from fleet.model.units import to_s
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent
from fleet.model.vehicle.models.point_mass import PointMassPerformance
from fleet.protocol.messages import Ack, Command, Decision, StateBroadcast, Truth
from fleet.protocol.surveillance import manoeuvre_of
from fleet.report.events import one_command_words
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from tests.conftest import KeepingRecorder, kept_run, truths

ALLOWED = Resolution(speed_candidates=7)
FASTER_MPS, SLOWER_MPS = 26.0, 25.0


def overtaking(first: int = 1, **changes: object) -> Scenario:
    """One UAV 445 m behind another on one track, and a little faster; `first` flies in front.

    UAV 1 computes: it is told nothing as long as the other can be led clear.
    """
    speeds = (SLOWER_MPS, FASTER_MPS) if first == 1 else (FASTER_MPS, SLOWER_MPS)
    easts = (445.0, 0.0) if first == 1 else (0.0, 445.0)
    uavs = tuple(
        Uav(n, (0.0, east, -300.0), 90.0, ((0.0, 3500.0, -300.0),), speed)
        for n, east, speed in zip((1, 2), easts, speeds, strict=True)
    )
    made = Scenario("overtaking", 150.0, uav=uavs, resolution=ALLOWED)
    return msgspec.structs.replace(made, **changes)


@cache
def flown(scenario: Scenario) -> KeepingRecorder:
    return kept_run(scenario)


def recorded_run(scenario: Scenario) -> RecordedRun:
    records = RecordCollector()
    run_recorder = RunRecorder(scenario, records)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return RecordedRun.of_records(scenario, records.kept, digest=run_recorder.digest)


def test_an_overtaker_waits_behind_on_its_course_and_all_get_home() -> None:
    run = flown(overtaking(first=1))
    told = [m for m in run.kept if isinstance(m, Command)]
    assert [c.manoeuvre for c in told] == ["speed", "resume", "speed"]  # and no to and fro
    assert {c.target for c in told} == {2}
    slowed = [c.speed_mps for c in told if c.speed_mps is not None]
    assert all(0.75 * FASTER_MPS <= v < SLOWER_MPS for v in slowed)
    assert not run.separation.lost()
    arrivals = run.arrivals.arrivals()
    assert arrivals.all_arrived == "yes"
    for truth in truths(run, 2):  # course and altitude of the plan throughout
        assert abs(truth.position_ned_m[0]) < 1e-3
        assert abs(truth.position_ned_m[2] + 300.0) < 1e-3


def test_who_is_overtaken_by_the_computing_uav_hurries() -> None:
    run = flown(overtaking(first=2))
    told = [m for m in run.kept if isinstance(m, Command)]
    assert {c.target for c in told} == {2}
    assert FASTER_MPS < told[0].speed_mps <= 1.25 * SLOWER_MPS  # type: ignore[operator]
    assert not run.separation.lost()
    assert run.arrivals.arrivals().all_arrived == "yes"
    assert min(run.arrivals.arrivals().delays_s) < 0.0  # it comes home sooner


def test_without_speeds_nobody_is_told_any_and_messages_are_as_ever() -> None:
    run = flown(overtaking(first=1, resolution=Resolution()))
    told = [m for m in run.kept if isinstance(m, Command)]
    assert "speed" not in {c.manoeuvre for c in told}
    assert told
    assert {m.speed_mps for m in run.kept if isinstance(m, Command)} == {None}
    broadcasts = [m for m in run.kept if isinstance(m, StateBroadcast)]
    assert {(m.guidance_speed_mps, m.commanded_speed_mps) for m in broadcasts} == {(None, None)}
    assert {m.commanded_speed_mps for m in run.kept if isinstance(m, Truth)} == {None}


def test_the_loss_of_time_is_told_and_comes_true() -> None:
    """Manoeuvre and intercept times of the decision; the delay is what was flown more slowly."""
    run = flown(overtaking(first=1))
    decision = next(m for m in run.kept if isinstance(m, Decision))
    (encounter,) = decision.encounters
    assert (encounter.stage, encounter.manoeuvre, encounter.sector) == ("speed", "speed", "rear")
    ended = next(m for m in run.kept if isinstance(m, Command) and m.manoeuvre == "resume")
    assert to_s(ended.start_ns) == pytest.approx(
        to_s(decision.t_ns) + encounter.manoeuvre_s, abs=2.0
    )
    regained_s = (FASTER_MPS - encounter.speed_mps) / 2.0  # type: ignore[operator]
    assert encounter.intercept_s - encounter.manoeuvre_s == pytest.approx(regained_s, abs=0.01)
    lost_m = sum(0.1 * (FASTER_MPS - t.speed_mps) for t in truths(run, 2) if not t.waypoint_index)
    (late_s,) = [r.delay_s for r in run.arrivals.arrivals().rows if r.id == 2]
    assert late_s == pytest.approx(lost_m / FASTER_MPS, abs=0.25)


def test_speeds_stay_within_their_shares() -> None:
    """What may be flown is a key: with little room the UAV slows down by that, or turns."""
    narrow = PointMassPerformance(min_speed_share=0.95, max_speed_share=1.0)
    run = flown(overtaking(first=1, performance=narrow))
    slowed = {m.speed_mps for m in run.kept if isinstance(m, Command) and m.speed_mps is not None}
    assert slowed
    assert min(slowed) >= 0.95 * FASTER_MPS
    assert min(t.speed_mps for t in truths(run, 2)) >= 0.95 * FASTER_MPS - 1e-9
    none = PointMassPerformance(min_speed_share=1.0, max_speed_share=1.0)
    still = flown(overtaking(first=1, performance=none))
    assert {m.speed_mps for m in still.kept if isinstance(m, Command)} == {None}


def test_the_axes_of_the_paper_come_first_where_they_lead_less_far_from_the_plan() -> None:
    """The side encounter is resolved by the climb that it is resolved by without speeds."""
    uavs = (
        Uav(1, (0.0, -1200.0, -300.0), 90.0, ((0.0, 4e3, -300.0),)),
        Uav(2, (-1200.0, 0.0, -300.0), 0.0, ((4e3, 0.0, -300.0),)),
    )
    with_speeds, without = (
        flown(Scenario("side", 60.0, uav=uavs, resolution=rules))
        for rules in (ALLOWED, Resolution())
    )
    told = [
        [(c.manoeuvre, c.climb_mps) for c in run.kept if isinstance(c, Command)]
        for run in (with_speeds, without)
    ]
    assert told[0] == told[1]
    assert told[0][0][0] == "climb"


# Whoever reads a run knows the manoeuvre


def test_the_invariants_hold_and_metrics_count_it() -> None:
    past = recorded_run(overtaking(first=1))
    verdicts = check(past)
    assert verdicts.broken == ()
    assert verdicts.overall is Verdict.VALID
    found = measure(past)
    (row,) = [u for u in found.uavs if u.id == 2]
    paced_s = sum(t.mode == "speed" for t in truths(flown(overtaking(first=1)), 2)) / 10.0
    assert row.commanded_s == pytest.approx(paced_s, abs=0.2)
    assert paced_s > 20.0
    assert row.path_deviation_max_m < 0.1
    assert {c.manoeuvre for c in found.commands.rows} == {"speed", "resume"}


def test_a_uav_that_flies_another_speed_than_it_acknowledged_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def slower(*told: Any) -> ActiveManoeuvre:
        manoeuvre = manoeuvre_of(*told)
        return msgspec.structs.replace(manoeuvre, speed_mps=manoeuvre.speed_mps - 0.5)

    monkeypatch.setattr("fleet.agents.vehicle.manoeuvre_of", slower)
    verdicts = check(recorded_run(overtaking(first=1, duration_s=20.0)))
    assert "flown as obeyed" in verdicts.broken


class Racing:
    """A resolver that asks for what may not be flown: twice the cruise speed."""

    def __init__(self, scenario: Scenario) -> None:
        """Needs nothing of the scenario."""

    def resolve(self, _situation: Situation) -> Sequence[Advisory]:
        """UAV 2 shall race."""
        return [Advisory(2, "speed", speed_mps=2.0 * FASTER_MPS, manoeuvre_s=30.0)]


def racing() -> Scenario:
    return overtaking(first=1, duration_s=10.0, resolver="tests.agents.test_speed:Racing")


def test_a_speed_that_may_not_be_flown_is_refused_and_that_is_right() -> None:
    run = flown(racing())
    reasons = {m.reason for m in run.kept if isinstance(m, Ack) and not m.accepted}
    assert reasons == {"beyond_limits"}
    assert {t.speed_mps for t in truths(run, 2)} == {FASTER_MPS}
    assert check(recorded_run(racing())).broken == ()


@pytest.mark.parametrize(
    "wrong",
    [
        (0.0, math.inf),  # obeys what it should refuse
        (90.0, 91.0),  # and the other way about
    ],
)
def test_who_does_not_know_its_limits_is_found(
    wrong: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    def careless(command: Command, uav: Recipient, now_ns: int) -> str:
        return refusal(command, dataclasses.replace(uav, speeds_mps=wrong), now_ns)

    scenarios = (racing(), overtaking(first=1, duration_s=20.0))
    assert not any(check(recorded_run(s)).broken for s in scenarios)
    monkeypatch.setattr("fleet.agents.agent.refusal", careless)
    broken = [check(recorded_run(s)).broken for s in scenarios]
    assert ("refused for a reason",) in broken


def test_an_aircraft_whose_process_is_stopped_or_dead_holds_the_speed_it_was_told() -> None:
    for fault in (Pause(node="2", start_s=10.0, end_s=14.0), Kill(node="2", start_s=10.0)):
        run = flown(overtaking(first=1, duration_s=20.0, fault=(fault,)))
        held = [t for t in truths(run, 2) if t.mode in ("held", "unmanned")]
        (speed,) = {t.commanded_speed_mps for t in held}
        assert speed is not None
        assert speed < SLOWER_MPS
        assert held[-1].speed_mps == pytest.approx(speed)


def test_a_uav_that_starts_again_regains_its_cruise_speed() -> None:
    kill = Kill(node="2", start_s=10.0, end_s=11.0)
    run = flown(overtaking(first=1, duration_s=14.0, fault=(kill,)))
    after = [t for t in truths(run, 2) if t.t_ns >= 11_100_000_000]
    assert after[0].speed_mps < FASTER_MPS
    assert {
        m.guidance_speed_mps for m in run.kept if isinstance(m, StateBroadcast) and m.id == 2
    } > {None}
    assert check(recorded_run(overtaking(first=1, duration_s=14.0, fault=(kill,)))).broken == ()


def test_the_resolver_knows_how_far_a_faster_uav_comes() -> None:
    """Who may speed up is near those whom it can come near, and zones allow for the speed."""
    plain, allowed = overtaking(resolution=Resolution()), overtaking()
    assert allowed.outlook().required.horizontal_m > plain.outlook().required.horizontal_m


def test_reports_and_exports_tell_of_speeds() -> None:
    command = next(m for m in flown(overtaking(first=1)).kept if isinstance(m, Command))
    assert manoeuvre_text(command).startswith(f"speed {command.speed_mps:.1f} m/s, until")
    assert one_command_words(command) == f"speed {command.speed_mps:.3g} m/s"


def test_whether_a_slowed_uav_can_go_on_is_asked_at_its_cruise_speed() -> None:
    """At 20 m/s behind one at 21 m/s it is safe; at its own 26 m/s it would not be for minutes."""
    slowed = State(0.0, 0.0, -300.0, 20.0, math.pi / 2)
    ahead = State(0.0, 500.0, -300.0, 21.0, math.pi / 2)
    plan = FlightPlan(((0.0, 9e5, -300.0),), math.pi / 2)
    geometry, kept = Geometry(overtaking()), Intent(math.pi / 2, 0.0, -300.0)
    manoeuvre = ActiveManoeuvre("speed", math.pi / 2, 0.0, speed_mps=20.0)
    for cruise_mps, ends in ((26.0, False), (20.5, True)):
        guidance = Intent(math.pi / 2, 0.0, -300.0, None, cruise_mps)
        craft = Aircraft(2, slowed, guidance, manoeuvre, plan)
        found = geometry.returning(
            craft, [intent_of(guidance, manoeuvre)], [(1, ahead, kept)], None
        )
        assert next(found) is ends
        manoeuvre_s, _ = geometry.manoeuvre_times_s(
            craft, intent_of(guidance, manoeuvre), [(1, ahead, kept)]
        )
        assert (manoeuvre_s < 80.0) is ends
