"""The coordinator as an operating system process."""

from __future__ import annotations

from fleet.config.traffic import participants
from fleet.coordinator.coordinator import Coordinator
from fleet.model.types import COORDINATOR
from fleet.node.join_info import JoinInfo
from fleet.node.participant import take_part


def coordinator_main(join_info: JoinInfo) -> None:
    """Be the coordinator of a run until its simulation stops it.

    Raises:
        ValueError: the run has no coordinator.

    """
    scenario = join_info.scenario
    if COORDINATOR not in participants(scenario):
        raise ValueError(
            f"scenario '{scenario.name}' has no coordinator: the UAVs elect among themselves "
            '(coordination.electors = "local")'
        )
    take_part(Coordinator(join_info.scenario, join_info.restart), join_info)
