"""The UAV as an operating system process."""

from __future__ import annotations

from fleet.agents.agent import Agent
from fleet.agents.resolvers import load_resolver
from fleet.config.traffic import uavs_of
from fleet.node.join_info import JoinInfo
from fleet.node.participant import take_part


def uav_main(join_info: JoinInfo, uav_id: int) -> None:
    """Be one UAV of a run until its simulation stops it.

    Raises:
        ValueError: the scenario has no such UAV, or its resolver cannot be loaded.

    """
    scenario = join_info.scenario
    for uav in uavs_of(scenario):
        if uav.id == uav_id:
            agent = Agent(uav, scenario, load_resolver(scenario), join_info.restart)
            take_part(agent, join_info)
            return
    raise ValueError(f"scenario '{scenario.name}' has no UAV {uav_id}")
