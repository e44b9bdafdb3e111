"""What a process must know to take part in a run, and how the simulation tells it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import msgspec

from fleet.config.checks import MAX_DISTANCE_M
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.model.elementary import hypot
from fleet.model.words import ClockMode
from fleet.node.node import RestartState
from fleet.security.identity import Identity
from fleet.transport.zenoh_session import LEASE_S, SessionOptions

REALTIME_PATIENCE_S = 0.1
"""In realtime nobody waits longer to get rid of a message: it connects anew."""


@dataclass(frozen=True)
class JoinInfo:
    """What a process must know to take part: where, in which run, on which clock, flying what."""

    endpoint: str
    run: str
    clock: str
    scenario: Scenario
    by_hand: bool = False
    restart: RestartState | None = None
    secure: str = ""
    """The folder with its certificate; without one the bus is open."""
    lease_s: float = LEASE_S
    zenoh_config: str = ""
    """A file of zenoh's own configuration."""

    def session_options(self, identity: Identity | None) -> SessionOptions:
        """A message may wait for its link: in lockstep everybody waits for it anyway."""
        realtime_clock = self.clock == ClockMode.REALTIME
        patience_s = REALTIME_PATIENCE_S if realtime_clock else self.lease_s
        return SessionOptions(identity, self.zenoh_config, self.lease_s, patience_s)


class _Plan(msgspec.Struct, frozen=True):
    clock: str
    scenario: Scenario
    uavs: tuple[Uav, ...] = ()
    lease_s: Annotated[float, msgspec.Meta(ge=0.5, le=86_400.0)] = LEASE_S
    restarts: dict[str, RestartState] = {}


def plan_bytes(
    clock: str,
    scenario: Scenario,
    lease_s: float = LEASE_S,
    restarts: Mapping[str, RestartState] | None = None,
) -> bytes:
    """What the simulation answers to participants that are started by hand.

    `uavs` are listed also where they are generated, for those who cannot generate them; `restarts`
    are what those find, by name, who come in the place of a process that has left.
    """
    plan = _Plan(clock, scenario, uavs_of(scenario), lease_s, dict(restarts or {}))
    return msgspec.json.encode(plan)


def join_info_of(
    endpoint: str,
    run: str,
    plan: bytes,
    secure: str = "",
    name: str = "",
    zenoh_config: str = "",
) -> JoinInfo:
    """The join info in a simulation's answer, for the participant of a name.

    Raises ValueError if it is not understood.
    """
    try:
        decoded = msgspec.json.decode(plan, type=_Plan)
    except RecursionError as error:
        raise ValueError("a plan nested too deeply") from error
    restart, scenario = decoded.restarts.get(name), decoded.scenario
    last_ns = scenario.ticks * scenario.tick_ns
    if restart and (restart.t_ns % scenario.tick_ns or restart.t_ns > last_ns):
        raise ValueError(f"a restart at {restart.t_ns} ns, which is no tick of the run")
    if restart and restart.truth and hypot(*restart.truth.position_ned_m) > MAX_DISTANCE_M:
        raise ValueError(f"a restart further than {MAX_DISTANCE_M:g} m from the origin")
    return JoinInfo(
        endpoint,
        run,
        decoded.clock,
        scenario,
        by_hand=True,
        restart=restart,
        secure=secure,
        lease_s=decoded.lease_s,
        zenoh_config=zenoh_config,
    )
