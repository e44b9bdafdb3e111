"""The UAV as an operating system process."""

from __future__ import annotations

from agents.agent import Agent
from agents.resolvers import load_resolver
from fleet.comms.participant import Membership, take_part
from fleet.model.generate import uavs_of


def uav_main(membership: Membership, uav_id: int) -> None:
    """Be one UAV of a run until its range stops it.

    Raises:
        ValueError: the scenario has no such UAV, or its resolver cannot be loaded.

    """
    scenario = membership.scenario
    for uav in uavs_of(scenario):
        if uav.id == uav_id:
            agent = Agent(uav, scenario, load_resolver(scenario), membership.revival)
            take_part(agent, membership)
            return
    raise ValueError(f"scenario '{scenario.name}' has no UAV {uav_id}")
