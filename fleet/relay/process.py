"""The relay as an operating system process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from fleet.config.traffic import uavs_of
from fleet.errors import ProgramError
from fleet.model.words import ClockMode
from fleet.node.join_info import JoinInfo
from fleet.node.participant import take_part
from fleet.relay.medium import FIRM, REALTIME_RETURN_S, AnswerLimits, Medium
from fleet.relay.pipe_medium import PipeMedium
from fleet.relay.questions import LastQuestion, StepQuestion, plan_question
from fleet.relay.relay_node import RelayNode
from fleet.relay.zenoh_medium import ZenohMedium
from fleet.transport.zenoh_bus import Bus

LEAST_SILENCE_S = 0.5
"""A program that has been silent for less is not said to be."""


class _Asking:
    """Asks a program what to do in each step, and knows what it has not answered yet."""

    def __init__(self, medium: Medium, limits: AnswerLimits) -> None:
        self._medium = medium
        self._limits = limits
        self._open: tuple[int, int] | None = None

    def ask(self, question: StepQuestion) -> object:
        """The answer; raises ProgramError."""
        self._open = question.tick, Bus.stopwatch_ns()
        try:
            return self._medium.ask(question, self._limits)
        finally:
            self._open = None

    def unfinished(self) -> str:
        """How long a question is open by now, in words; empty if none is, or just so."""
        asked = self._open
        silent_s = (Bus.stopwatch_ns() - asked[1]) / 1e9 if asked else 0.0
        if asked is None or silent_s < LEAST_SILENCE_S:
            return ""
        return f"its program had not answered tick {asked[0]} for {silent_s:.1f} s"


def relay_main(join_info: JoinInfo, uav_id: int, program: Sequence[str], wait_s: float) -> None:
    """Be one UAV of a run, flown by a program, until the simulation stops it.

    With a `program` it is started, and asked over a pipe; else one is asked over zenoh, which has
    to be there within `wait_s`.

    Raises:
        ValueError: the scenario has no such UAV.
        ProgramError: the program is not there, has gone, or answers what cannot be sent.

    """
    scenario, restart = join_info.scenario, join_info.restart
    uav = next((each for each in uavs_of(scenario) if each.id == uav_id), None)
    if uav is None:
        raise ValueError(f"scenario '{scenario.name}' has no UAV {uav_id}")
    medium: Medium = PipeMedium(program) if program else ZenohMedium()
    realtime_clock = join_info.clock == ClockMode.REALTIME
    limits = AnswerLimits(join_info.lease_s, REALTIME_RETURN_S) if realtime_clock else FIRM
    asking = _Asking(medium, limits)
    node = RelayNode(uav, scenario, asking.ask, restart)
    first = plan_question(uav, scenario, join_info.run, join_info.clock, restart)

    @contextmanager
    def dialogue(bus: Bus) -> Iterator[None]:
        bus.unfinished = asking.unfinished
        try:
            medium.begin(bus, first, wait_s)
            yield
        except ProgramError:
            medium.abandon()
            raise
        finally:
            medium.end(LastQuestion())

    take_part(node, join_info, dialogue)
