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
from fleet.relay.questions import LastQuestion, plan_question
from fleet.relay.relay_node import RelayNode
from fleet.relay.zenoh_medium import ZenohMedium
from fleet.transport.zenoh_bus import Bus


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
    node = RelayNode(uav, scenario, lambda asked: medium.ask(asked, limits), restart)
    first = plan_question(uav, scenario, join_info.run, join_info.clock, restart)

    @contextmanager
    def dialogue(bus: Bus) -> Iterator[None]:
        try:
            medium.begin(bus, first, wait_s)
            yield
        except ProgramError:
            medium.abandon()
            raise
        finally:
            medium.end(LastQuestion())

    take_part(node, join_info, dialogue)
