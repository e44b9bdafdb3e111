"""The coordinator as an operating system process."""

from __future__ import annotations

from coordinator.coordinator import Coordinator
from fleet.comms.messages import COORDINATOR
from fleet.comms.participant import Membership, take_part
from fleet.model.generate import participants


def coordinator_main(membership: Membership) -> None:
    """Be the coordinator of a run until its range stops it.

    Raises:
        ValueError: the run has no coordinator.

    """
    scenario = membership.scenario
    if COORDINATOR not in participants(scenario):
        raise ValueError(
            f"scenario '{scenario.name}' has no coordinator: the UAVs elect among themselves "
            '(coordination.electors = "local")'
        )
    take_part(Coordinator(membership.scenario, membership.revival), membership)
