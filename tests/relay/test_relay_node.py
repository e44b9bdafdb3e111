"""A relay's node in runs in memory: it makes no difference, whatever the plan does."""

from __future__ import annotations

from typing import Any

import pytest

import fleet
from fleet.analysis.recorded_run import RecordedRun
from fleet.node.node import InboxMessage
from fleet.protocol.messages import Ack, Command, StateBroadcast
from fleet.relay.answers import FILLED_IN, HEADER, SHARED
from fleet.relay.questions import StepQuestion
from fleet.relay.relay_node import RelayNode
from fleet.simulation import in_memory
from tests.relay.programs import example_program, own_program, plain, relayed
from tests.support.samples import MS, adsb, head_on, truth

LINKS = {"latency": "300ms", "jitter": "200ms", "loss": "25%", "burst": "3", "duplicate": "10%"}
LINKS |= {"reorder": "10%", "replay": "5%", "rate": "200kbit", "partition": "1/2@20s+3s"}
PLANS = {
    "none": {},
    "links": {**LINKS, "corrupt": "2%", "range": "5km"},
    "clock": {"clock-offset": "2:700ms"},
    "noise": {"gps-noise": "2:10m"},
    "dropout": {"gps-dropout": "2@20s+10s"},
    "killed": {"kill": "2@30s+5s", "loss": "20%"},
    "paused": {"pause": "2@30s+5s", "loss": "20%"},
}
SETTINGS = {"seed": 3, "duration_s": 40}


def flown(monkeypatch: pytest.MonkeyPatch, make: Any, scenario: Any) -> RecordedRun:
    """A run with UAV 2 behind a relay."""
    with monkeypatch.context() as patched:
        patched.setattr(in_memory, "Agent", relayed(make, 2))
        return fleet.run(scenario)


@pytest.mark.parametrize("plan", PLANS)
def test_a_relay_makes_no_difference(plan: str, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {**SETTINGS, "uav.2.equipment": "no_compute"}
    scenario = fleet.load_scenario("four_way", settings, PLANS[plan])
    assert flown(monkeypatch, own_program, scenario).digest == fleet.run(scenario).digest


def test_a_program_may_compute_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {**SETTINGS, "uav.1.equipment": "no_compute"}
    scenario = fleet.load_scenario("four_way", settings, LINKS | {"clock-offset": "2:300ms"})
    ours = fleet.run(scenario)
    assert any(isinstance(m, Command) and m.id == 2 for m in ours.messages())
    assert flown(monkeypatch, own_program, scenario).digest == ours.digest


@pytest.mark.parametrize("plan", ["links", "clock", "noise", "killed"])
def test_the_example_flies_under_any_plan(plan: str, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {**SETTINGS, "uav.2.equipment": "no_compute"}
    run = flown(
        monkeypatch, example_program, fleet.load_scenario("four_way", settings, PLANS[plan])
    )
    assert fleet.check(run).broken == ()
    assert any(isinstance(m, Ack) and m.id == 2 and m.accepted for m in run.messages())


def test_all_keep_clear_of_the_example_and_come_home(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"uav.2.equipment": "no_compute", "surveillance.range_m": 6000, "duration_s": 245}
    run = flown(monkeypatch, example_program, fleet.load_scenario("four_way", settings))
    least = fleet.measure(run).totals.least_separation
    assert fleet.check(run).overall == "valid"
    assert least is not None
    assert least > 1.0
    arrived = {m.id for m in run.messages() if isinstance(m, StateBroadcast) and m.arrived}
    assert arrived == {1, 2, 3, 4}


def test_a_program_is_not_told_of_what_is_implausible() -> None:
    scenario, asked = head_on(), list[StepQuestion]()

    def ask(question: StepQuestion) -> object:
        asked.append(question)
        told = plain(truth(2, (0.0, 0.0, -300.0), question.t_ns))
        state = ["truth", {k: v for k, v in told.items() if k not in HEADER}]
        return [state, *([["adsb", INTENT]] if question.broadcast else [])]

    node = RelayNode(scenario.uav[1], scenario, ask)
    for tick, north_m in enumerate((0.0, 5.0, 9000.0), start=1):
        now_ns = tick * 200 * MS
        heard = adsb(1, (north_m, 0.0, -300.0), t_ns=now_ns - 100 * MS, seq=tick)
        node.step(now_ns, [InboxMessage(now_ns, heard)])
    told = [[item.message.seq for item in question.inbox] for question in asked]
    assert told == [[1], [2], []]
    assert node.implausible == [(1, 3)]
    assert [question.present for question in asked] == [(1,)] * 3


INTENT = {
    name: value
    for name, value in plain(adsb(2)).items()
    if name not in (*FILLED_IN[StateBroadcast], *SHARED)
}
