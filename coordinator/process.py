"""The coordinator as an operating system process."""

from __future__ import annotations

from coordinator.coordinator import Coordinator
from fleet.comms.participant import Membership, take_part


def coordinator_main(membership: Membership) -> None:
    """Be the coordinator of a run until its range stops it."""
    take_part(Coordinator(membership.scenario, membership.revival), membership)
