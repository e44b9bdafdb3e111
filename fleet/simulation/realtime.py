"""The realtime clock, as the simulation conducts it: everybody steps by its own, from one epoch."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from fleet.errors import FleetStoppedError
from fleet.faults.plan import plan_json
from fleet.model.units import to_ns
from fleet.model.words import ClockState
from fleet.node.gate import FUTURE_TOLERANCE_NS
from fleet.protocol import codec
from fleet.protocol.attendance import LAST_WORDS_NS
from fleet.protocol.messages import Clock, Done, Outage
from fleet.protocol.sample import Sample
from fleet.protocol.topics import CLOCK, issuer_name, issuer_of
from fleet.simulation.clock_check import compare_clocks
from fleet.simulation.run_context import ZenohRunContext
from fleet.transport.free_memory import GIVE_BACK_EVERY_S, give_back_free_memory
from fleet.transport.interface import ReceivedMessage
from fleet.transport.zenoh_bus import Bus

EPOCH_LEAD_NS = 200_000_000
"""Realtime begins this long after everybody is ready, so that all have heard when."""


def conduct_realtime(bus: Bus, run: ZenohRunContext) -> Iterator[int]:
    """Set the epoch, then listen for as long as the run lasts; yields the time tick by tick."""
    scenario, registry, barrier = run.scenario, run.registry, run.barrier
    while barrier.waiting:
        item = run.listener.hear(_next(bus), 0)
        if item is not None and isinstance(item[2], Done):
            _welcome(item, barrier.waiting, run)
    barrier.joining = False
    compare_clocks(bus, run.run_recorder.tally.clocks, registry.schedule.nodes, 0)
    epoch_ns = bus.now_unix_ns() + EPOCH_LEAD_NS
    _announce(bus, run, Clock(0, 0, ClockState.EPOCH, {}, epoch_ns), epoch_ns)
    barrier.expect(registry.schedule.nodes)
    run.outages.excuse(registry.schedule.nodes, 0)
    returning: set[str] = set()
    between_trims = max(1, to_ns(GIVE_BACK_EVERY_S) // scenario.tick_ns)
    for tick in range(scenario.ticks + 1):
        clock = _enter(bus, run, tick, epoch_ns, returning)
        due_ns = epoch_ns + (tick + 1) * scenario.tick_ns
        while (arrival := bus.next_before(due_ns)) is not None:
            if _note(arrival, epoch_ns, run, returning):
                plan = plan_json(registry.plan)
                again = Clock(tick, clock.t_ns, ClockState.EPOCH, {}, epoch_ns, plan=plan)
                _announce(bus, run, again, epoch_ns)
        run.outages.excuse((*registry.schedule.held, *registry.schedule.down), clock.t_ns)
        run.run_recorder.vanished = registry.vanished(tick) | frozenset(run.outages.left)
        for item in registry.unmanned(tick):
            run.run_recorder.note(item, clock.t_ns)
        run.run_recorder.tell_refused(clock.t_ns)
        barrier.moved()
        if tick % between_trims == 0:
            give_back_free_memory()
        yield clock.t_ns
    _hear_last_words(bus, run, epoch_ns, returning)
    end_ns = scenario.ticks * scenario.tick_ns
    compare_clocks(bus, run.run_recorder.tally.clocks, registry.schedule.nodes, end_ns)
    _stop(bus, run, scenario.ticks, scenario.ticks * scenario.tick_ns)


def _enter(bus: Bus, run: ZenohRunContext, tick: int, epoch_ns: int, returning: set[str]) -> Clock:
    """Carry out what a realtime tick brings, and tell everybody if it changes anything."""
    plan = run.new_plan(tick)
    changes = run.registry.enter(tick, plan)
    for change, restart in changes:
        run.carry_out(change, restart)
        if change.action == "restart":
            returning.add(issuer_name(change.node))
    clock = run.registry.clock(tick, {}, new_plan=plan is not None)
    if changes or plan is not None:
        _announce(bus, run, msgspec.structs.replace(clock, state=ClockState.PLAN), epoch_ns)
    return clock


def _hear_last_words(bus: Bus, run: ZenohRunContext, epoch_ns: int, returning: set[str]) -> None:
    """Wait until everybody who is there has said that it is through.

    Who has been started again and was not ready in time has said nothing, and waits for the end.
    """
    schedule, barrier = run.registry.schedule, run.barrier
    barrier.waiting -= {issuer_name(n) for n in (*schedule.held, *schedule.down)} | returning
    until_ns = bus.now_unix_ns() + LAST_WORDS_NS
    while barrier.waiting and (arrival := bus.next_before(until_ns)) is not None:
        _note(arrival, epoch_ns, run, returning)
        if issuer_of(arrival.topic) in barrier.waiting:  # its clock is behind: it is not through
            until_ns = bus.now_unix_ns() + LAST_WORDS_NS
        barrier.waiting -= {issuer_name(node) for node in run.outages.left}
    end_ns = run.scenario.ticks * run.scenario.tick_ns
    barrier.waiting -= {issuer_name(node) for node in run.outages.silent(end_ns + LAST_WORDS_NS)}
    for outage in run.outages.finish(end_ns):
        run.run_recorder.tell_outage(outage)
    if barrier.waiting:
        raise FleetStoppedError(f"no last message from {', '.join(sorted(barrier.waiting))}")


def _announce(bus: Bus, run: ZenohRunContext, clock: Clock, epoch_ns: int) -> None:
    """Say what has been carried out by now; the log tells when that was, for whoever checks it."""
    payload, said_ns = codec.encode(clock), max(0, bus.now_unix_ns() - epoch_ns)
    _say(bus, run, payload)
    run.listener.know(clock, said_ns)
    run.run_recorder.clock(clock, payload, said_ns)


def _note(arrival: Sample, epoch_ns: int, run: ZenohRunContext, returning: set[str]) -> bool:
    """Enter a message; True if it is that a process, which has been started again, is ready."""
    arrived_ns = arrival.arrived_unix_ns - epoch_ns
    item = run.listener.hear(arrival, arrived_ns + FUTURE_TOLERANCE_NS)
    if item is None:
        return False
    if isinstance(item[2], Done) and item[2].tick < 0:
        if item[2].id in run.outages.absent(arrived_ns) and epoch_ns:
            _take_back(item[2].id, arrived_ns, run)
        else:
            _welcome(item, returning, run)
        return True
    _end_outage(run.outages.heard(item[2].id, arrived_ns), run)
    if isinstance(item[2], Done) and item[2].tick != run.scenario.ticks:
        raise run.listener.intrusion(item[0], "out of turn")
    run.listener.enter(item, max(0, arrived_ns))
    if isinstance(item[2], Done):
        run.barrier.heard(issuer_of(item[0]))
    run.registry.note([item[2]])
    run.run_recorder.note(item, max(0, arrived_ns))
    return False


def _take_back(node: int, at_ns: int, run: ZenohRunContext) -> None:
    """Another process comes in the place of one that has left, as its next incarnation."""
    for truth in run.registry.flown_alone(node):
        run.run_recorder.note((*codec.on_wire(truth), truth), max(0, at_ns))
        run.registry.note([truth])
    run.registry.schedule.restarted(node)
    _end_outage(run.outages.restarted(node, at_ns), run)


def _end_outage(outage: Outage | None, run: ZenohRunContext) -> None:
    """Put an outage that is over on record; what was sent in it may be missing."""
    if outage is not None:
        run.listener.excuse(outage)
        run.run_recorder.tell_outage(outage)


def _welcome(item: ReceivedMessage, awaited: set[str], run: ZenohRunContext) -> None:
    """A process says that it is ready, if it is awaited."""
    name = issuer_of(item[0])
    if name not in awaited:
        raise run.listener.intrusion(item[0], "out of turn")
    awaited.discard(name)


def _next(bus: Bus) -> Sample:
    while True:
        arrival = bus.next_before(bus.now_unix_ns() + 1_000_000_000)
        if arrival is not None:
            return arrival


def _say(bus: Bus, run: ZenohRunContext, payload: bytes) -> None:
    run.barrier.words.say(CLOCK, payload)
    bus.put(CLOCK, payload)


def _stop(bus: Bus, run: ZenohRunContext, tick: int, t_ns: int) -> None:
    _say(bus, run, codec.encode(Clock(tick, t_ns, ClockState.STOP, {})))
