"""What a relay asks the program that flies its UAV; docs/protocol/foreign.md specifies it.

Three kinds of question, told by their first key: `plan` once, `tick` in every step, `stop` at the
end. Encoded they are maps with named fields, messages as they are on the wire.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
from msgspec import Struct

from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.model.types import Position
from fleet.node.node import RestartState
from fleet.protocol.messages import Ack, Command, Election, Message, StateBroadcast
from fleet.protocol.surveillance import state_of


class UavStart(Struct, frozen=True):
    """Where a UAV begins, and what it remembers: that of who comes back is from before it left."""

    t_ns: int
    position_ned_m: Position
    speed_mps: float
    heading_rad: float
    climb_mps: float
    waypoint_index: int
    highest_term: int
    mandate_term: int
    applied_term: int
    applied_number: int


class PlanQuestion(Struct, frozen=True):
    """What there is to know before the run; `uav` is its own table, with nothing left open.

    `uavs` are the numbers of all UAVs.
    """

    run: str
    number: int
    clock: str
    tick_ns: int
    scenario: Scenario
    uav: Uav
    uavs: tuple[int, ...]
    start: UavStart


class InboxItem(Struct, frozen=True, array_like=True):
    """A message of the inbox, and the moment to act on it: after the last step, and by this one."""

    at_ns: int
    kind: str
    message: Message


class StepQuestion(Struct, frozen=True):
    """What a step begins with.

    `broadcast` says whether a broadcast is due, `present` of whom one has come that is not too old.
    """

    tick: int
    t_ns: int
    broadcast: bool
    present: tuple[int, ...]
    inbox: tuple[InboxItem, ...]


class FirstQuestion(Struct, frozen=True):
    """Asked once, before the relay joins: the answer says that the program is there."""

    plan: PlanQuestion


class LastQuestion(Struct, frozen=True):
    """The relay leaves; nobody waits for what is answered."""

    stop: bool = True


RelayQuestion = FirstQuestion | StepQuestion | LastQuestion


def plan_question(
    uav: Uav, scenario: Scenario, run: str, clock: str, restart: RestartState | None
) -> FirstQuestion:
    """The first question to the program of a UAV."""
    resolved = msgspec.structs.replace(
        uav,
        guidance_climb_mps=uav.guidance_climb_mps or scenario.guidance.climb_mps,
        zone=uav.zone or scenario.zone,
        performance=uav.performance or scenario.performance,
    )
    numbers = tuple(each.id for each in uavs_of(scenario))
    start = _start_of(uav, restart)
    return FirstQuestion(
        PlanQuestion(run, uav.id, clock, scenario.tick_ns, scenario, resolved, numbers, start)
    )


def _start_of(uav: Uav, restart: RestartState | None) -> UavStart:
    truth = restart.truth if restart else None
    memory = restart.memory if restart else None
    state = state_of(truth) if truth else uav.state()
    climb_mps = 0.0 - state.velocity_ned_mps[2] if truth else uav.climb_mps
    return UavStart(
        restart.t_ns if restart else 0,
        state.position_ned_m,
        state.speed_mps,
        state.heading_rad,
        float(climb_mps),
        truth.waypoint_index if truth else 0,
        memory.highest_term if memory else 0,
        memory.mandate_term if memory else 0,
        memory.applied_term if memory else 0,
        memory.applied_number if memory else 0,
    )


OWN_TIMES: dict[type[Message], tuple[str, ...]] = {
    StateBroadcast: ("applies_ns",),
    Election: ("valid_until_ns",),
    Command: ("issued_ns", "start_ns", "manoeuvre_end_ns", "expiry_ns"),
    Ack: ("issued_ns",),
}
"""Fields with times that a UAV reads by its own clock."""


def moved(message: Message, by_ns: int) -> Message:
    """A message with those of its times moved that a UAV reads by its own clock.

    So a program knows one time alone, and goes by a wrong clock all the same.
    """
    names: Iterable[str] = OWN_TIMES.get(type(message), ())
    if not by_ns or not names:
        return message
    times = {name: max(0, getattr(message, name) + by_ns) for name in names}
    return msgspec.structs.replace(message, **times)
