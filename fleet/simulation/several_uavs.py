"""Several UAVs of one host: a process each, forked from one that has loaded everything already."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from queue import SimpleQueue

from fleet.agents.resolvers import load_resolver
from fleet.config.traffic import uavs_of
from fleet.config.uav_numbers import ranges_of
from fleet.node.join_info import JoinInfo
from fleet.protocol.topics import issuer_name
from fleet.simulation.interrupts import Interrupts
from fleet.simulation.os_limits import check_room
from fleet.simulation.supervisor import ProcessSupervisor, death_of
from fleet.transport.zenoh_bus import LOST_SIMULATION_EXIT

FAILED_EXIT = 1
SPOKEN_EXITS = (0, FAILED_EXIT, LOST_SIMULATION_EXIT)
"""Exit codes of processes that have said themselves what they had to."""


def several_uavs(join_infos: Mapping[int, JoinInfo]) -> int:
    """Be these UAVs of a run, until all of their processes have ended; none outlives this one.

    The result is an exit code: 0 if all were stopped by their simulation, that of a participant
    which lost it if nothing worse happened, 1 else. Each that ends early is named on standard
    error; the others go on.

    Raises:
        ValueError: the scenario has no such UAVs, or its resolver cannot be loaded.
        NoRoomError: the operating system's limits are too low for the processes.
        KeyboardInterrupt: a signal; all are ended.

    """
    numbers, join_info = list(join_infos), next(iter(join_infos.values()))
    check_flown(join_info, numbers)
    load_resolver(join_info.scenario)  # what is wrong with it is told once
    check_room(len(numbers))
    interrupts = Interrupts()
    ended: SimpleQueue[tuple[str, int]] = SimpleQueue()
    supervisor = ProcessSupervisor(join_info, numbers, interrupts)
    left = {issuer_name(number): number for number in numbers}
    codes = []
    interrupts.install()
    try:
        supervisor.start(lambda name, code: ended.put((name, code)), join_infos)
        while left:
            name, code = ended.get()
            del left[name]
            codes.append(code)
            if code not in SPOKEN_EXITS:
                what = f"process {name} ended early ({death_of(code)})"
                print(f"fleet: {what}", file=sys.stderr, flush=True)
    except BaseException:
        for name in supervisor.pids().keys() & left.keys():
            supervisor.kill(left[name])
        raise
    finally:
        supervisor.stop()
        interrupts.restore()
    bad = {*codes} - {0, LOST_SIMULATION_EXIT}
    return FAILED_EXIT if bad else max(codes)


def check_flown(join_info: JoinInfo, numbers: Sequence[int]) -> None:
    """Raises ValueError if the scenario of a run has not all of these UAVs."""
    flown = {uav.id for uav in uavs_of(join_info.scenario)}
    strange = set(numbers) - flown
    if strange:
        raise ValueError(
            f"scenario '{join_info.scenario.name}' has no UAV {ranges_of(strange)}: it has "
            f"{ranges_of(flown)}"
        )
