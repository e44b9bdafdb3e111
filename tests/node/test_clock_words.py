"""What a participant makes of the clock's word."""

from __future__ import annotations

import json

import msgspec
import pytest

import fleet
from fleet.agents.agent import Agent
from fleet.agents.resolvers import load_resolver
from fleet.config.traffic import uavs_of
from fleet.model.words import ClockState
from fleet.node import clock_words
from fleet.node.clock_words import clock_of
from fleet.node.join_info import join_info_of, plan_bytes
from fleet.node.node import RestartState
from fleet.node.progress import read_progress
from fleet.protocol.codec import encode
from fleet.protocol.messages import Clock, Truth
from fleet.protocol.sample import DELETION, Sample
from fleet.protocol.topics import CLOCK

HEAD_ON = fleet.load_scenario("head_on")
GRANT = Clock(3, 300_000_000, ClockState.RUN, {"adsb/0": ((1, 1), (2, 1))})


def said(plan: str, *, flaw: str = "") -> Sample:
    clock = Clock(GRANT.tick, GRANT.t_ns, GRANT.state, GRANT.expected, plan=plan)
    return Sample(CLOCK, encode(clock), flaw=flaw)


def test_a_grant_without_a_plan_costs_no_reading_of_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    """What reads plans knows all kinds of faults: each process would load them to begin with."""
    monkeypatch.setattr(clock_words, "plan_of", None)
    assert clock_of(said("")) == GRANT


@pytest.mark.parametrize("plan", ["[", "{}", '[{"kind": "none such"}]', "[" * 100_000])
def test_a_grant_with_a_plan_that_cannot_be_read_is_none(plan: str) -> None:
    assert clock_of(said("[]")) is not None
    assert clock_of(said(plan)) is None


def test_a_grant_with_a_flaw_is_none() -> None:
    assert clock_of(said("", flaw=DELETION)) is None


@pytest.mark.parametrize("name", ["head_on", "converge", "crossing"])
def test_the_answer_of_a_simulation_lists_the_uavs_also_where_they_are_generated(name: str) -> None:
    scenario = fleet.load_scenario(name)
    told = json.loads(plan_bytes("lockstep", scenario))
    assert [uav["id"] for uav in told["uavs"]] == [uav.id for uav in uavs_of(scenario)]
    first = uavs_of(scenario)[0]
    assert told["uavs"][0]["position_ned_m"] == [*first.position_ned_m]
    assert told["uavs"][0]["equipment"] == first.equipment


@pytest.mark.parametrize(
    ("restart", "where"),
    [
        ({"incarnation": 10**7, "t_ns": 0}, "incarnation"),
        ({"incarnation": 1, "t_ns": -1}, "t_ns"),
        ({"incarnation": 1, "t_ns": 150_000_000}, "no tick of the run"),
        ({"incarnation": 1, "t_ns": 10**15}, "no tick of the run"),
    ],
)
def test_a_plan_whose_restarts_have_no_numbers_left_is_not_understood(
    restart: dict[str, int], where: str
) -> None:
    """Who begins with them could send no message that others take."""
    told = json.loads(plan_bytes("realtime", fleet.load_scenario("head_on")))
    with pytest.raises(ValueError, match=where):
        join_info_of("", "", json.dumps({**told, "restarts": {"1": restart}}).encode(), name="1")


def test_a_plan_by_which_an_aircraft_is_beyond_all_bounds_is_not_understood() -> None:
    """It could not tell where it is as soon as it has flown on."""
    node = Agent(uavs_of(HEAD_ON)[0], HEAD_ON, load_resolver(HEAD_ON))
    truth = next(m for m in node.step(0, []) if isinstance(m, Truth))
    for north_m, understood in ((8.9e6, True), (9.1e6, False)):
        there = msgspec.structs.replace(truth, position_ned_m=(north_m, 0.0, -300.0))
        restart = RestartState(1, 5_000_000_000, truth=there)
        plan = plan_bytes("realtime", HEAD_ON, restarts={"1": restart})
        if understood:
            assert join_info_of("", "", plan, name="1").restart == restart
        else:
            with pytest.raises(ValueError, match="further than"):
                join_info_of("", "", plan, name="1")


@pytest.mark.parametrize("answer", [b"", b"7", b'{"x": ' + b"[" * 100_000])
def test_an_answer_that_is_no_progress_is_none(answer: bytes) -> None:
    assert read_progress(answer) is None
