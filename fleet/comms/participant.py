"""Taking part in a run over zenoh: the loop that a UAV's and the coordinator's process share."""

from __future__ import annotations

import gc
from dataclasses import dataclass

import msgspec

from fleet.comms import codec
from fleet.comms.keys import CLOCK, is_broadcast, issuer_name, topic_of
from fleet.comms.messages import Clock, Late
from fleet.comms.station import LockstepTiming, Node, RealtimeTiming, Station, counts
from fleet.comms.zenoh_bus import Arrival, Bus, BusError, open_client_bus
from fleet.model.faults.channel import Channel
from fleet.model.scenario import Scenario

LATE_FRACTION = 0.1
"""A realtime step that begins later than this fraction of a tick is counted as late."""

FOREVER_NS = 2**62


@dataclass(frozen=True)
class Membership:
    """What a process must know to take part: where, in which run, on which clock, flying what."""

    endpoint: str
    run: str
    clock: str
    scenario: Scenario
    by_hand: bool = False


class _Plan(msgspec.Struct, frozen=True):
    clock: str
    scenario: Scenario


def plan_bytes(clock: str, scenario: Scenario) -> bytes:
    """What the range answers to participants that are started by hand."""
    return msgspec.json.encode(_Plan(clock, scenario))


def membership_of(endpoint: str, run: str, plan: bytes) -> Membership:
    """The membership that a range's answer gives; raises ValueError if it is not understood."""
    decoded = msgspec.json.decode(plan, type=_Plan)
    return Membership(endpoint, run, decoded.clock, decoded.scenario, by_hand=True)


def channel_of(scenario: Scenario) -> Channel:
    """The links into one participant, under the scenario's fault plan."""
    return Channel(scenario.fault, scenario.seed, scenario.tick_ns)


def lockstep_station(node: Node, scenario: Scenario) -> Station:
    """A node's station in simulated time, the same on every bus."""
    return Station(node, LockstepTiming(scenario.tick_ns), channel_of(scenario))


def take_part(node: Node, membership: Membership) -> None:
    """Run a node until the range stops the run."""
    name = issuer_name(node.id)
    gc.freeze()  # what the fork server loaded stays shared, and is never scanned again
    with open_client_bus(membership.run, name, membership.endpoint) as bus:
        if membership.by_hand:
            _check_place(bus, name)
        bus.end_without("range")
        if membership.clock == "lockstep":
            lockstep(lockstep_station(node, membership.scenario), bus)
        else:
            channel = channel_of(membership.scenario)
            realtime(Station(node, RealtimeTiming(), channel), bus, membership.scenario)


def _check_place(bus: Bus, name: str) -> None:
    """A process that joins by hand may come too late, or be one too many."""
    if not bus.is_alive("range"):
        raise BusError(f"run {bus.run}: its range has gone; start 'fleet run' again")
    if bus.is_alive(name):
        raise BusError(f"run {bus.run}: {name} takes part already; choose another ID")


def lockstep(station: Station, bus: Bus) -> None:
    """Step when a tick is granted and everything that its manifest counts has come."""
    heard = [(suffix, f"*/{suffix}") for suffix in station.node.hears]
    bus.listen(CLOCK)
    for suffix, topic in heard:
        bus.listen(topic, own=not is_broadcast(suffix))
    bus.announce()
    bus.put(*station.done(-1, 0, []))
    owned: dict[str, int] = {}
    while True:
        clock = codec.decode_clock(bus.take(CLOCK).payload)
        if clock.state == "stop":
            return
        for suffix, topic in heard:
            own = owned.get(suffix, 0) if is_broadcast(suffix) else 0
            for _ in range(clock.expected.get(suffix, 0) - own):
                arrival = bus.take(topic)
                station.accept(arrival.topic, arrival.payload)
        sent = station.step(clock.t_ns)
        for topic, payload in sent:
            bus.put(topic, payload)
        owned = counts(sent)
        bus.put(*station.done(clock.tick, clock.t_ns, sent))


def realtime(station: Station, bus: Bus, scenario: Scenario) -> None:
    """Step on the wall clock from the common epoch; late steps are reported, never hidden."""
    bus.stamp(CLOCK)
    for suffix in station.node.hears:
        bus.stamp(f"*/{suffix}", own=not is_broadcast(suffix))
    bus.announce()
    bus.put(*station.done(-1, 0, []))
    epoch_ns, tick, late = 0, 0, 0
    early: list[Arrival] = []
    while tick <= scenario.ticks:
        due_ns = epoch_ns + tick * scenario.tick_ns if epoch_ns else FOREVER_NS
        arrival = bus.next_before(due_ns)
        if arrival is not None and arrival.topic == CLOCK:
            clock = codec.decode_clock(arrival.payload)
            if clock.state == "stop":
                return
            epoch_ns = clock.epoch_unix_ns
            for before in early:
                _accept(station, before, epoch_ns)
        elif arrival is not None and not epoch_ns:
            early.append(arrival)  # another process has begun already
        elif arrival is not None:
            _accept(station, arrival, epoch_ns)
        else:
            now_ns = tick * scenario.tick_ns
            behind_ns = bus.now_unix_ns() - due_ns
            for topic, payload in station.step(now_ns):
                bus.put(topic, payload)
            if behind_ns > LATE_FRACTION * scenario.tick_ns:
                report = Late(station.node.id, late, now_ns, behind_ns)
                late += 1
                bus.put(topic_of(report), codec.encode(report))
            tick += 1
    bus.put(*station.done(tick - 1, (tick - 1) * scenario.tick_ns, []))
    _await_stop(bus)


def _accept(station: Station, arrival: Arrival, epoch_ns: int) -> None:
    transit_ns = arrival.arrived_unix_ns - arrival.put_unix_ns if arrival.put_unix_ns else 0
    station.accept(
        arrival.topic,
        arrival.payload,
        max(0, arrival.arrived_unix_ns - epoch_ns),
        transit_ns=max(0, transit_ns),
    )


def _await_stop(bus: Bus) -> None:
    while True:
        arrival = bus.next_before(FOREVER_NS)
        if arrival is not None and arrival.topic == CLOCK:
            clock: Clock = codec.decode_clock(arrival.payload)
            if clock.state == "stop":
                return
