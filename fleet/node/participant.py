"""Taking part in a run over zenoh: the loop that a UAV's and the coordinator's process share."""

from __future__ import annotations

import gc
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from fleet.config.scenario import Scenario
from fleet.errors import BusError
from fleet.faults.channel import Channel
from fleet.model.words import ClockMode
from fleet.node.delay_line import DelayLine
from fleet.node.gate import credible
from fleet.node.holding import LockstepTiming, RealtimeTiming
from fleet.node.join_info import JoinInfo
from fleet.node.lockstep_loop import lockstep
from fleet.node.node import Node, RestartState
from fleet.node.realtime_loop import realtime
from fleet.node.runner import NodeRunner
from fleet.protocol.topics import ABORT, issuer_name
from fleet.security.identity import identity_of
from fleet.transport.zenoh_bus import Bus, open_client_bus


def channel_of(scenario: Scenario) -> Channel:
    """The links into one participant, under the scenario's fault plan."""
    return Channel(scenario.fault, scenario.seed, scenario.tick_ns)


def lockstep_runner(
    node: Node, scenario: Scenario, restart: RestartState | None = None
) -> NodeRunner:
    """A node runner in simulated time, the same on every bus."""
    return NodeRunner(
        node,
        LockstepTiming(scenario.tick_ns),
        channel_of(scenario),
        incarnation=restart.incarnation if restart else 0,
        credible=credible(scenario),
    )


During = Callable[[Bus], AbstractContextManager[None]]
"""What is there while a process takes part, entered before anybody is told of it."""


def take_part(node: Node, join_info: JoinInfo, during: During = lambda _: nullcontext()) -> None:
    """Run a node until the simulation stops the run."""
    scenario, restart = join_info.scenario, join_info.restart
    name = issuer_name(node.id)
    gc.freeze()  # what the fork server loaded stays shared, and is never scanned again
    realtime_clock = join_info.clock == ClockMode.REALTIME
    with open_client_bus(
        join_info.run,
        name,
        join_info.endpoint,
        options=join_info.session_options(identity_of(join_info.secure, name)),
    ) as bus:
        if join_info.by_hand:
            _check_place(bus, name)
            bus.end_on(ABORT)
        node.stopwatch = bus.stopwatch_ns
        returns_s = join_info.lease_s if realtime_clock else 0.0
        bus.end_without("sim", patience_s=returns_s, silently=not join_info.by_hand)
        with during(bus):
            if realtime_clock:
                _by_the_wall_clock(node, bus, scenario, restart)
            else:
                lockstep(lockstep_runner(node, scenario, restart), bus, scenario)


def _by_the_wall_clock(
    node: Node, bus: Bus, scenario: Scenario, restart: RestartState | None
) -> None:
    incarnation = restart.incarnation if restart else 0
    with DelayLine() as line:
        runner = NodeRunner(
            node,
            RealtimeTiming(),
            channel_of(scenario),
            line,
            incarnation=incarnation,
            credible=credible(scenario),
        )
        realtime(runner, bus, scenario, line, incarnation)


def _check_place(bus: Bus, name: str) -> None:
    """A process that joins by hand may come too late, or be one too many."""
    if not bus.is_alive("sim"):
        raise BusError(f"run {bus.run}: its simulation has gone; start 'fleet run' again")
    if bus.is_alive(name):
        raise BusError(f"run {bus.run}: {name} takes part already; choose another ID")
