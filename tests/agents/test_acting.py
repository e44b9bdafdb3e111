"""Who does not act is passed over: the deaf, the unanswering and the unequipped."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from fleet.analysis.invariants import RecordedRun, Verdict, check
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.loading import read_scenario
from fleet.config.scenario import Coordination, Resolution, Scenario
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.faults.rules import Rule
from fleet.protocol import codec
from fleet.protocol.messages import (
    Ack,
    Command,
    Conflict,
    DeliveryReport,
    Election,
    Message,
    StateBroadcast,
)
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from tests.analysis.test_check_story import RecordedRunBuilder, broadcast, elect
from tests.analysis.test_check_story import apart as far_apart
from tests.support.mutants import meeting
from tests.support.samples import S

DURATION_S = 40.0


class Flown:
    """A run in memory: what was sent, how near the UAVs came, and the verdicts on it."""

    def __init__(self, scenario: Scenario) -> None:
        records = RecordCollector()
        self.run_recorder = RunRecorder(scenario, records)
        for _ in run_in_memory(scenario, self.run_recorder):
            pass
        kept = [r for r in records.kept if not r.topic.startswith("sim/")]
        self.messages: list[Message] = [codec.decode(r.topic, r.payload) for r in kept]
        recorded_run = RecordedRun.of_records(
            scenario, records.kept, digest=self.run_recorder.digest
        )
        self.verdicts = check(recorded_run)

    def of(self, cls: type[Message]) -> list[Any]:
        return [m for m in self.messages if isinstance(m, cls)]

    def commanders(self) -> set[int]:
        """Who gave commands that were obeyed."""
        return {m.target for m in self.of(Ack) if m.accepted}


def apart(*plan: Rule, equipment: dict[int, str] | None = None, **changes: Any) -> Scenario:
    """Three UAVs that meet, from further away than `meeting`."""
    few = Resolution(turn_candidates=7, climb_candidates=5, horizon_s=30.0, sample_s=2.0)
    scenario = meeting(*plan, duration_s=DURATION_S, tick_s=0.2, resolution=few, **changes)
    uavs = []
    for uav in scenario.uav:
        north, east, down = uav.position_ned_m
        place = (1.5 * north, 1.5 * east, down)
        kind: Any = (equipment or {}).get(uav.id, "full")
        uavs.append(msgspec.structs.replace(uav, position_ned_m=place, equipment=kind))
    return msgspec.structs.replace(scenario, uav=tuple(uavs))


def deaf(src: str = "*", classes: str = "*") -> Loss:
    """UAV 1 does not hear these."""
    return Loss(src=src, dst="1", classes=classes, probability=1.0)


@pytest.mark.parametrize(
    ("fault", "until_s"),
    [
        (deaf("coordinator"), 4.8),
        (deaf(classes="election"), 4.8),
        (deaf("uav"), 2.2),
        (deaf(), 2.2),
    ],
    ids=("coordinator", "elections", "uavs", "all"),
)
def test_a_deaf_computing_uav_is_passed_over_within_the_limit(fault: Loss, until_s: float) -> None:
    """It says after 1.5 s that it hears nobody; an answer is missing after 4 s."""
    run = Flown(apart(fault))
    first = min(e.t_ns for e in run.of(Election) if e.computing == 2)
    assert first <= until_s * S
    assert run.commanders() == {2}
    assert run.run_recorder.separation.least() >= 1.0
    assert run.verdicts.broken == ()


def test_a_deaf_uav_that_hears_again_leads_again() -> None:
    fault = Loss(dst="1", classes="election", probability=1.0, end_s=6.0)
    found = [(e.t_ns, e.computing) for e in Flown(apart(fault)).of(Election)]
    passed_ns = min(t for t, who in found if who == 2)
    back_ns = min(t for t, who in found if who == 1 and t > passed_ns)
    assert 4 * S < passed_ns <= 4.8 * S
    # It answers the first election after the fault, and must have acted for 4 s by then.
    assert 10 * S <= back_ns <= 11.6 * S
    assert {who for t, who in found if t >= back_ns} == {1}


def test_without_a_coordinator_too_who_hears_nobody_is_passed_over() -> None:
    run = Flown(apart(deaf(), coordination=Coordination("local")))
    assert run.commanders() == {2}
    assert run.run_recorder.separation.least() >= 1.0
    assert run.verdicts.broken == ()


# Commands that do not arrive


def in_vain(src: str = "*", dst: str = "*", classes: str = "cmd") -> Loss:
    return Loss(src=src, dst=dst, classes=classes, probability=1.0)


@pytest.mark.parametrize("electors", ["coordinator", "local"])
@pytest.mark.parametrize(
    ("fault", "leaders"),
    [
        (in_vain(src="1"), {1, 2, 3}),
        (in_vain(dst="2"), {1}),
        (in_vain(dst="3"), {1}),
        (in_vain(dst="1", classes="ack"), {1}),
        (in_vain(), {1, 2, 3, 4}),
    ],
    ids=("of UAV 1", "to UAV 2", "to UAV 3", "answers", "all"),
)
def test_one_whose_commands_are_not_answered_is_passed_over_and_all_get_home(
    fault: Loss, leaders: set[int], electors: Any
) -> None:
    """In the paper's encounter; commands to oneself do not go by a link, and arrive."""
    scenario = read_scenario("four_way", ["duration_s=290"]).scenario
    scenario = msgspec.structs.replace(
        scenario, fault=(fault,), coordination=Coordination(electors)
    )
    run = Flown(scenario)
    assert run.run_recorder.separation.least() >= 1.0
    assert {e.computing for e in run.of(Election)} <= leaders
    arrivals = run.run_recorder.arrivals.arrivals()
    assert all(row.arrived for row in arrivals.rows)
    assert run.verdicts.broken == ()
    assert run.run_recorder.tally.unresolved == 0


def test_one_whose_commands_are_not_answered_says_so_until_its_group_has_gone() -> None:
    run = Flown(
        msgspec.structs.replace(
            read_scenario("four_way", ["duration_s=290"]).scenario, fault=(in_vain(src="1"),)
        )
    )
    said = {m.t_ns: m.hears for m in run.of(StateBroadcast) if m.id == 1}
    first_ns = min(m.t_ns for m in run.of(Command) if m.target != 1)
    not_heeded = [t for t, hears in said.items() if not hears]
    assert 4 * S < min(not_heeded) - first_ns <= 5 * S
    passed_ns = min(e.t_ns for e in run.of(Election) if e.computing == 2)
    assert min(not_heeded) < passed_ns <= min(not_heeded) + S
    assert max(not_heeded) < max(said)
    between = [hears for t, hears in said.items() if min(not_heeded) <= t <= max(not_heeded)]
    assert not any(between)


def test_one_that_is_dead_leaves_no_command_in_vain() -> None:
    """UAV 2 is killed when it has been commanded: the others answer, and UAV 1 leads on."""
    scenario = read_scenario("four_way", ["duration_s=60"]).scenario
    kill = Kill(node="2", start_s=29.0)
    run = Flown(msgspec.structs.replace(scenario, fault=(kill,)))
    assert {e.computing for e in run.of(Election)} == {1}
    assert all(m.hears for m in run.of(StateBroadcast) if m.id == 1)


# Equipment


@pytest.mark.parametrize(
    ("equipment", "leader", "electors"),
    [
        ({1: "no_compute", 2: "no_compute"}, 3, "coordinator"),
        ({1: "deaf"}, 2, "coordinator"),
        ({2: "deaf"}, 1, "coordinator"),
        ({1: "deaf", 2: "no_compute"}, 3, "coordinator"),
        ({1: "deaf", 2: "no_compute"}, 3, "local"),
    ],
    ids=str,
)
def test_the_lowest_that_can_compute_leads_round_those_that_do_not_obey(
    equipment: dict[int, str], leader: int, electors: Any
) -> None:
    run = Flown(apart(equipment=equipment, coordination=Coordination(electors)))
    assert {e.computing for e in run.of(Election)} == {leader}
    assert run.commanders() == {leader}
    assert run.run_recorder.separation.least() >= 1.0
    assert run.verdicts.broken == ()
    assert run.verdicts.overall is Verdict.VALID


@pytest.mark.parametrize(
    ("equipment", "broadcasts", "hears"),
    [
        ("full", True, True),
        ("no_compute", True, True),
        ("deaf", True, False),
        ("mute", False, True),
        ("none", False, False),
    ],
)
def test_each_equipment_does_what_its_table_says(
    equipment: str, broadcasts: bool, hears: bool
) -> None:
    run = Flown(apart(equipment={2: equipment}))
    said = {m.equipment for m in run.of(StateBroadcast) if m.id == 2}
    assert said == ({equipment} if broadcasts else set())
    assert any(m.id == 2 for m in run.of(DeliveryReport)) is hears
    told = any(m.target == 2 for m in run.of(Command))
    assert told is (broadcasts and hears)
    assert any(m.id == 2 for m in run.of(Ack)) is told
    assert (2 in {u for e in run.of(Election) for u in e.members}) is broadcasts
    assert run.verdicts.broken == ()


def test_a_group_in_which_nobody_can_compute_has_no_leader_and_the_coordinator_says_so() -> None:
    run = Flown(apart(equipment={1: "no_compute", 2: "deaf", 3: "no_compute"}))
    assert run.of(Election) == run.of(Command) == []
    told = [m.leaderless for m in run.of(Conflict)]
    assert set(told) == {(), (1, 2, 3)} or set(told) == {(1, 2, 3)}
    assert run.run_recorder.tally.leaderless == {1, 2, 3}
    assert run.run_recorder.separation.least() < 1.0
    assert run.verdicts.broken == ()


def test_what_was_not_for_a_deaf_uav_is_not_missing_in_the_result() -> None:
    run = Flown(apart(equipment={2: "deaf", 3: "none"}))
    tally = run.run_recorder.tally
    fates = sum(n for (kind, _), n in tally.fates.items() if kind == "adsb")
    last_tick = {m.id for m in run.of(StateBroadcast) if m.t_ns == DURATION_S * S}
    assert tally.sent["adsb"] == fates + sum(1 if i == 1 else 2 for i in last_tick)


# Hand-written runs


NAME = "lowest eligible leads"


def leads(
    run_builder: RecordedRunBuilder, term: int, computing: int, begin_s: float, end_s: float
) -> None:
    """An election of UAVs 1 and 2, repeated."""
    for n in range(round((end_s - begin_s) / 0.6)):
        at_s = round(begin_s + 0.6 * n, 1)
        told = elect(term, (1, 2), at_s, at_s + 2.0)
        run_builder.tell(msgspec.structs.replace(told, computing=computing))


def long() -> RecordedRunBuilder:
    return RecordedRunBuilder(far_apart(duration_s=12.0))


@pytest.mark.parametrize(
    ("said", "shown", "why"),
    [
        ({"hears": False}, "hears=no", "hears nobody of its group"),
        ({"equipment": "no_compute"}, "equipment=no_compute", "cannot compute"),
    ],
)
def test_one_that_says_that_it_cannot_lead_is_elected(
    said: dict[str, Any], shown: str, why: str
) -> None:
    run_builder = long()
    run_builder.fly(2, 3, until_s=3.0)
    run_builder.fly(1, until_s=3.0, **said)
    run_builder.tell(elect(4, (1, 2), 1.0, 3.0))
    assert run_builder.proof(NAME) == [
        f"the lowest eligible is 2, not UAV 1, which {why}",
        "1.000 s  coordinator/election  term=4 members=1,2 computing=1",
        "0.800 s  2/adsb/0  seq=4 heard_s=0.900",
        f"0.800 s  1/adsb/0  seq=4 heard_s=0.900 {shown}",
    ]


def test_a_word_for_equipment_that_is_none_is_taken_for_the_least() -> None:
    run_builder = long()
    run_builder.fly(2, 3, until_s=3.0)
    run_builder.fly(1, until_s=3.0, equipment="something")
    run_builder.tell(elect(4, (1, 2), 1.0, 3.0))
    told = run_builder.check().of(NAME).why
    assert told == "the lowest eligible is 2, not UAV 1, which cannot compute"


def answering(*uavs: int) -> RecordedRunBuilder:
    """These say that they are under term 4; the others never under any."""
    run_builder = long()
    for uav in (1, 2, 3):
        answers = {"mandate_term": 4, "mandate_valid": True, "highest_term": 4}
        run_builder.fly(uav, until_s=12.0, **(answers if uav in uavs else {}))
    return run_builder


def test_one_that_answers_leads_on() -> None:
    run_builder = answering(1, 2)
    leads(run_builder, 4, 1, 1.0, 11.0)
    assert run_builder.check().broken == ()


def test_one_that_does_not_answer_leads_on() -> None:
    run_builder = answering(2)
    leads(run_builder, 4, 1, 1.0, 6.0)
    assert run_builder.proof(NAME)[:2] == [
        "the lowest eligible is 2, not UAV 1, which has not answered the elections that name it",
        "5.200 s  coordinator/election  term=4 members=1,2 computing=1",
    ]


def test_one_that_does_not_answer_is_passed_over_in_time_and_too_early() -> None:
    run_builder = answering(2)
    leads(run_builder, 4, 1, 1.0, 5.0)
    leads(run_builder, 8, 2, 5.2, 8.0)
    assert run_builder.check().of(NAME).verdict is Verdict.VALID
    run_builder = answering(2)
    leads(run_builder, 4, 1, 1.0, 4.0)
    leads(run_builder, 8, 2, 4.6, 8.0)
    assert run_builder.check().of(NAME).why == "the lowest eligible is 1, not UAV 2"


@pytest.mark.parametrize(("back_s", "right"), [(5.0, False), (6.8, False), (7.0, True)])
def test_one_that_was_passed_over_comes_back_after_it_has_acted_for_a_while(
    back_s: float, right: bool
) -> None:
    """Silent from 0.4 s to 2.8 s: passed over at 2.2 s and 2.8 s, and fit since 2.9 s."""
    run_builder = long()
    run_builder.fly(2, 3, until_s=12.0, mandate_term=4, mandate_valid=True)
    for at_s in (*(0.2 * n for n in range(3)), *(0.2 * n for n in range(14, 50))):
        answer = {"mandate_term": 4, "mandate_valid": True}
        run_builder.tell(broadcast(run_builder.scenario.uav[0], round(at_s, 1), **answer))
    leads(run_builder, 4, 2, 2.2, 3.4)
    run_builder.tell(elect(8, (1, 2), back_s, back_s + 2.0))
    assert (run_builder.check().of(NAME).verdict is Verdict.VALID) is right


def test_what_a_uav_says_of_its_equipment_tells_what_it_should_hear() -> None:
    """A third party that joined as it is, whatever the scenario says."""
    run_builder = long()
    run_builder.fly(1, 3, until_s=1.0)
    run_builder.fly(2, until_s=1.0, equipment="deaf", hears=False)
    assert "nothing lost silently" not in run_builder.check().broken
    assert "received was sent" in run_builder.check().broken, "its reports tell otherwise"
