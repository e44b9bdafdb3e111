"""`fleet fault` names what it was given, whatever number that has in the plan of the run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest
import typer
from msgspec import structs

from fleet.cli import fault
from fleet.config.fault_checks import fault_problems
from fleet.config.loading import load_scenario
from fleet.simulation.active_runs import ActiveRun
from fleet.simulation.fault_control import MOST_REQUESTS, FaultControl, answer_of
from fleet.transport.zenoh_bus import Bus

Answer = Callable[[bytes, Callable[[bytes], None]], None]


class BusOfOneRun:
    """A bus on which the simulation of one run answers."""

    def answer(self, _: str, answer: Answer) -> None:
        self.take = answer


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is on, with a fault plan of one rule."""
    scenario = load_scenario("side", faults={"latency": "1s"})
    control, bus = FaultControl(scenario), BusOfOneRun()
    control.listen(cast("Bus", bus))

    def ask(*asked: Any) -> bytes:
        answers: list[bytes] = []
        bus.take(asked[3], answers.append)
        control.new_plan(scenario.fault, 10)
        return answers[0]

    monkeypatch.setattr(fault, "ask", ask)
    monkeypatch.setattr(fault, "meant_run", lambda *_: ActiveRun("run", "tcp/x:1", "side"))


def test_requests_that_wait_are_bounded_and_the_rest_is_answered_at_once() -> None:
    scenario = load_scenario("side")
    control, bus = FaultControl(scenario), BusOfOneRun()
    control.listen(cast("Bus", bus))
    answers: list[bytes] = []
    for _ in range(MOST_REQUESTS + 2):
        bus.take(b'{"clear": true}', answers.append)
    assert len(answers) == control.lacked_room == 2
    assert all(b"requests wait; ask again" in answer for answer in answers)
    control.new_plan(scenario.fault, 10)
    assert len(answers) == MOST_REQUESTS + 2


@pytest.mark.parametrize("end", ["999", "-1", "2"])
def test_a_rule_that_is_not_there_cannot_be_ended(end: str) -> None:
    scenario = load_scenario("side", faults={"latency": "300ms", "loss": "20%"})
    control, bus = FaultControl(scenario), BusOfOneRun()
    control.listen(cast("Bus", bus))
    answers: list[bytes] = []
    bus.take(f'{{"end": [0, {end}]}}'.encode(), answers.append)
    assert control.new_plan(scenario.fault, 10) is None
    problem = answer_of(answers[0]).problem
    assert problem == f"no rule {end} in the fault plan; its rules are 0 to 1"
    bus.take(b'{"end": [3]}', answers.append)
    control.new_plan((), 10)
    assert answer_of(answers[1]).problem == "no rule 3 in the fault plan; it has none"


def test_who_flies_is_told_as_it_is() -> None:
    scenario = load_scenario("four_way", faults={"kill": "4@30s"})
    uavs = tuple(structs.replace(u, id=7) if u.id == 4 else u for u in scenario.uav)
    (problem,) = fault_problems(structs.replace(scenario, uav=uavs))
    assert problem.endswith("'4' names nobody whom it could concern; the UAVs are 1-3, 7")


@pytest.mark.usefixtures("run")
def test_what_a_run_refuses_is_named_as_it_was_given(capsys: pytest.CaptureFixture[str]) -> None:
    assert fault.fault(faults={"loss": ["5%"], "kill": ["9@30s"]}) == 2
    words = "'9' names nobody whom it could concern; the UAVs are 1, 2"
    assert capsys.readouterr().err == f"fleet: run run refuses: --kill 9@30s (node): {words}\n"


@pytest.mark.usefixtures("run")
def test_what_does_nothing_is_named_as_it_was_given(capsys: pytest.CaptureFixture[str]) -> None:
    assert fault.fault(faults={"loss": ["0%"]}) == 0
    out, err = capsys.readouterr()
    assert err == "fleet: warning: --loss 0% does nothing: its probability is 0\n"
    assert [line.split()[1] for line in out.splitlines()[1:]] == ["latency", "loss"]


@pytest.mark.usefixtures("run")
def test_what_cannot_be_is_named_before_anybody_is_asked() -> None:
    with pytest.raises(
        typer.BadParameter, match=r"^--range 0m \(max_m\): expected a number >= 0.001"
    ):
        fault.fault(faults={"range": ["0m"]})
