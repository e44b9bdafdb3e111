"""Sensing: what participants tell of place and time is what the fault plan makes of the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator

from fleet.analysis.invariants.accounting import name
from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Examination, witness
from fleet.faults.sensors import SensorRule, Sensors
from fleet.model.equipment import broadcasts
from fleet.model.units import to_ns, to_s, wrap_angle
from fleet.model.vehicle.flight import State
from fleet.model.words import UNMANNED
from fleet.protocol.messages import Command, Message, StateBroadcast, Truth
from fleet.protocol.surveillance import state_of

SAME = 1e-6
"""m, m/s, rad: two machines do not agree on the last bit of a sine."""


def positions(index: Index) -> Examination:
    """Each broadcast tells what plan and seed make of the true state at that moment.

    Without a rule that is the truth. Who senses nothing does not broadcast; in lockstep who senses
    where it is broadcasts when it is time, and then alone.
    """
    examination = Examination()
    for uav in index.uavs:
        if not _determined(index, uav):
            continue
        for truth, sensed, due in _moments(index, uav):
            said = index.broadcasts.get((uav, truth.t_ns))
            examination.examined += said is not None
            if said is None and sensed is not None and due:
                examination.blame(
                    f"UAV {uav} does not broadcast, though it is time", witness(truth)
                )
            elif said is not None and not due and not index.run.realtime:
                examination.blame(f"UAV {uav} broadcasts before it is time", witness(said, "seq"))
            elif said is not None and (sensed is None or not _same(said, sensed)):
                where = _place(sensed) if sensed else "nowhere, as its sensors are out"
                what = f"by the fault plan UAV {uav} takes itself to be {where}"
                shown = witness(truth, "position_ned_m", "velocity_ned_mps")
                examination.blame(what, shown, witness(said, "position_ned_m", "velocity_ned_mps"))
    return examination


def clocks(index: Index) -> Examination:
    """All that is told by the clock of its sender shows the time that the plan makes of it.

    That is the time of a broadcast's state, the end of an election's validity, and when a command
    was issued, as it is told first.
    """
    examination = Examination()
    for message, field, told_ns in _times(index):
        if not index.plan_is_known and not index.keeps_time(message.id):
            continue
        examination.examined += 1
        right_ns = index.local_ns(message.id, message.t_ns)
        if told_ns != right_ns:
            whose = f"the clock of {name(message.id)}"
            what = f"{whose} shows {to_s(told_ns):g} s, and {to_s(right_ns):g} s by the fault plan"
            examination.blame(what, witness(message, field))
    return examination


def _times(index: Index) -> Iterator[tuple[Message, str, int]]:
    """Messages with the reading of their senders' clocks, and the field that tells it."""
    for broadcast in index.broadcasts.values():
        yield broadcast, "applies_ns", broadcast.applies_ns
    valid_ns = index.scenario.election_timing().valid_ns
    for election in index.elections:
        yield election, "valid_until_ns", election.valid_until_ns - valid_ns
    first: dict[tuple[int, int, int], Command] = {}
    for command in index.commands:
        if first.setdefault((command.id, command.term, command.number), command) is command:
            yield command, "issued_ns", command.issued_ns


def _determined(index: Index, uav: int) -> bool:
    """Whether it is on record by what the UAV went; in realtime not where a position froze."""
    rules = [r for r in index.run.plan if isinstance(r, SensorRule) and r.hits(uav)]
    if not rules or not index.run.realtime:
        return True
    return index.plan_is_known and not any(r.remembers for r in rules)


def _moments(index: Index, uav: int) -> Iterator[tuple[Truth, State | None, bool]]:
    """Each step of a UAV: its true state, what it senses, and whether it is to broadcast.

    A process that is started again senses anew, and takes up the broadcasts where it was restarted.
    """
    plan, seed, tick_ns = index.run.plan, index.scenario.seed, index.tick_ns
    period_ns = to_ns(index.scenario.surveillance.broadcast_s)
    telling = broadcasts(index.equipped(uav)) and not index.run.realtime
    restarts_ns = [
        again_ns for _, again_ns in reversed(index.absences.downs[uav]) if again_ns is not None
    ]
    sensors, last_ns = Sensors(plan, seed, uav), -1
    for truth in index.truths[uav]:
        if truth.mode in UNMANNED:
            continue
        now_ns = truth.t_ns
        while restarts_ns and restarts_ns[-1] <= now_ns:
            sensors, last_ns = Sensors(plan, seed, uav), restarts_ns.pop() - tick_ns
        due = telling and now_ns // period_ns > last_ns // period_ns
        last_ns = now_ns
        if due or not sensors.clean or (uav, now_ns) in index.broadcasts:
            yield truth, sensors.sense(state_of(truth), now_ns), due


def _same(said: StateBroadcast, sensed: State) -> bool:
    told, right = said.position_ned_m + said.velocity_ned_mps, sensed.position_ned_m
    turned_rad = wrap_angle(said.heading_rad - sensed.heading_rad)
    return (
        math.dist(told, right + sensed.velocity_ned_mps) <= SAME
        and abs(said.speed_mps - sensed.speed_mps) <= SAME
        and abs(turned_rad) <= SAME
        and abs(said.flight_path_rad - sensed.flight_path_rad) <= SAME
    )


def _place(sensed: State) -> str:
    return "at " + ",".join(f"{x:.6g}" for x in sensed.position_ned_m)
