"""The two clocks, as the simulation conducts them: lockstep and realtime."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import msgspec

from fleet.config.scenario import Scenario
from fleet.errors import FleetStoppedError
from fleet.faults.lifecycle import LifecycleChange
from fleet.faults.plan import FaultRule, plan_json
from fleet.node.gate import FUTURE_TOLERANCE_NS
from fleet.node.runner import RestartState
from fleet.protocol import codec
from fleet.protocol.attendance import LAST_WORDS_NS
from fleet.protocol.messages import Clock, Done
from fleet.protocol.sample import Sample
from fleet.protocol.topics import CLOCK, EVERYTHING, issuer_name, issuer_of
from fleet.simulation.listener import Listener, OwnMessages
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.run_recorder import Manifest, ReceivedMessage, RunRecorder, manifest
from fleet.transport.zenoh_bus import Bus

EPOCH_LEAD_NS = 200_000_000
"""Realtime begins this long after everybody is ready, so that all have heard when."""


class TickBarrier:
    """Whom the simulation waits for, and has heard of, in a tick; `busy` while it waits.

    `items` is what has come of the tick in work.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = frozenset(names)
        self.words = OwnMessages()
        self.waiting: set[str] = set(names)
        self.items: list[ReceivedMessage] = []
        self.moved_s = time.monotonic()
        self.busy = True

    def expect(self, numbers: Iterable[int]) -> None:
        """These are awaited from now on."""
        self.waiting = {issuer_name(n) for n in numbers}
        self.moved_s = time.monotonic()
        self.busy = True

    def heard(self, name: str) -> None:
        """One of them has reported."""
        self.waiting.discard(name)


class RunContext(Protocol):
    """What a clock needs of the run that it conducts."""

    @property
    def scenario(self) -> Scenario:
        """What is flown."""
        ...

    @property
    def registry(self) -> ProcessRegistry:
        """Who takes part."""
        ...

    @property
    def run_recorder(self) -> RunRecorder:
        """Where everything is entered."""
        ...

    @property
    def barrier(self) -> TickBarrier:
        """Who is awaited."""
        ...

    @property
    def listener(self) -> Listener:
        """What hears."""
        ...

    def new_plan(self, tick: int) -> tuple[FaultRule, ...] | None:
        """The fault plan from this tick on, if the operator has changed it."""
        ...

    def carry_out(self, change: LifecycleChange, restart: RestartState | None) -> None:
        """Kill, stop or continue a process, or start it again."""
        ...


def conduct_lockstep(bus: Bus, stage: RunContext, speed: float) -> Iterator[int]:
    """Grant tick after tick, each once everything of the one before is there; yields their times.

    What a tick left is worked up while the participants are busy with the next one.
    """
    scenario, registry, run_recorder, barrier = (
        stage.scenario,
        stage.registry,
        stage.run_recorder,
        stage.barrier,
    )
    stage.listener.audit(_collect(bus, stage, -1, 0))
    begun_s = time.monotonic()
    heard, items = list[ReceivedMessage](), list[ReceivedMessage]()
    listed: Manifest = {}
    for tick in range(scenario.ticks + 1):
        now_ns = tick * scenario.tick_ns
        if speed > 0.0:
            time.sleep(max(0.0, begun_s + now_ns / 1e9 / speed - time.monotonic()))
        plan = stage.new_plan(tick)
        for change, restart in registry.enter(tick, plan):
            barrier.expect([change.node] if change.action == "restart" else [])
            stage.carry_out(change, restart)
            stage.listener.audit(_collect(bus, stage, -1, now_ns))
        clock = registry.clock(tick, listed, new_plan=plan is not None)
        absent = {*clock.held, *clock.down}
        barrier.expect(n for n in registry.schedule.nodes if n not in absent)
        payload = codec.encode(clock)
        _say(bus, stage, payload)
        if tick > 0:
            stage.listener.audit(heard)
            run_recorder.close(tick - 1, now_ns - scenario.tick_ns, items)
            yield now_ns - scenario.tick_ns
        run_recorder.clock(clock, payload)
        heard = _collect(bus, stage, tick, now_ns)
        listed = manifest(heard)
        registry.note(item[2] for item in heard)
        items = heard + registry.unmanned(tick)
        run_recorder.vanished = registry.vanished(tick)
    end_ns = scenario.ticks * scenario.tick_ns
    heard += [i for a in bus.waiting(EVERYTHING) if (i := stage.listener.hear(a, end_ns))]
    stage.listener.audit(heard)
    run_recorder.close(scenario.ticks, end_ns, items)
    yield end_ns
    _stop(bus, stage, scenario.ticks, end_ns)


def _collect(bus: Bus, stage: RunContext, tick: int, now_ns: int) -> list[ReceivedMessage]:
    """All messages of one tick: until everybody is done and all that they sent has come."""
    owed, barrier = 0, stage.barrier
    items = barrier.items = list[ReceivedMessage]()
    while barrier.waiting or owed > 0:
        item = stage.listener.hear(bus.take(EVERYTHING), now_ns)
        if item is None:
            continue
        items.append(item)
        owed -= 1
        message = item[2]
        if isinstance(message, Done):
            if issuer_of(item[0]) not in barrier.waiting or message.tick != tick:
                raise stage.listener.intrusion(item[0], "out of turn")
            barrier.heard(issuer_of(item[0]))
            owed += sum(message.sent.values()) + 1
    barrier.busy = False
    return items


def conduct_realtime(bus: Bus, stage: RunContext) -> Iterator[int]:
    """Set the epoch, then listen for as long as the run lasts; yields the time tick by tick."""
    scenario, registry, barrier = stage.scenario, stage.registry, stage.barrier
    while barrier.waiting:
        item = stage.listener.hear(_next(bus), 0)
        if item is not None and isinstance(item[2], Done):
            _welcome(item, barrier.waiting, stage)
    epoch_ns = bus.now_unix_ns() + EPOCH_LEAD_NS
    _announce(bus, stage, Clock(0, 0, "epoch", {}, epoch_ns), epoch_ns)
    barrier.expect(registry.schedule.nodes)
    returning: set[str] = set()
    for tick in range(scenario.ticks + 1):
        clock = _enter(bus, stage, tick, epoch_ns, returning)
        due_ns = epoch_ns + (tick + 1) * scenario.tick_ns
        while (arrival := bus.next_before(due_ns)) is not None:
            if _note(arrival, epoch_ns, stage, returning):
                plan = plan_json(registry.plan)
                again = Clock(tick, clock.t_ns, "epoch", {}, epoch_ns, plan=plan)
                _announce(bus, stage, again, epoch_ns)
        stage.run_recorder.vanished = registry.vanished(tick)
        for item in registry.unmanned(tick):
            stage.run_recorder.note(item, clock.t_ns)
        stage.run_recorder.tell_refused(clock.t_ns)
        barrier.moved_s = time.monotonic()
        yield clock.t_ns
    _hear_last_words(bus, stage, epoch_ns, returning)
    _stop(bus, stage, scenario.ticks, scenario.ticks * scenario.tick_ns)


def _enter(bus: Bus, stage: RunContext, tick: int, epoch_ns: int, returning: set[str]) -> Clock:
    """Carry out what a realtime tick brings, and tell everybody if it changes anything."""
    plan = stage.new_plan(tick)
    changes = stage.registry.enter(tick, plan)
    for change, restart in changes:
        stage.carry_out(change, restart)
        if change.action == "restart":
            returning.add(issuer_name(change.node))
    clock = stage.registry.clock(tick, {}, new_plan=plan is not None)
    if changes or plan is not None:
        _announce(bus, stage, msgspec.structs.replace(clock, state="plan"), epoch_ns)
    return clock


def _hear_last_words(bus: Bus, stage: RunContext, epoch_ns: int, returning: set[str]) -> None:
    """Wait until everybody who is there has said that it is through.

    Who has been started again and was not ready in time has said nothing, and waits for the end.
    """
    schedule, barrier = stage.registry.schedule, stage.barrier
    barrier.waiting -= {issuer_name(n) for n in (*schedule.held, *schedule.down)} | returning
    until_ns = bus.now_unix_ns() + LAST_WORDS_NS
    while barrier.waiting and (arrival := bus.next_before(until_ns)) is not None:
        _note(arrival, epoch_ns, stage, returning)
    if barrier.waiting:
        raise FleetStoppedError(f"no last message from {', '.join(sorted(barrier.waiting))}")


def _announce(bus: Bus, stage: RunContext, clock: Clock, epoch_ns: int) -> None:
    """Say what has been carried out by now; the log tells when that was, for whoever checks it."""
    payload, said_ns = codec.encode(clock), max(0, bus.now_unix_ns() - epoch_ns)
    _say(bus, stage, payload)
    stage.listener.know(clock, said_ns)
    stage.run_recorder.clock(clock, payload, said_ns)


def _note(arrival: Sample, epoch_ns: int, stage: RunContext, returning: set[str]) -> bool:
    """Enter a message; True if it is that a process, which has been started again, is ready."""
    arrived_ns = arrival.arrived_unix_ns - epoch_ns
    item = stage.listener.hear(arrival, arrived_ns + FUTURE_TOLERANCE_NS)
    if item is None:
        return False
    if isinstance(item[2], Done) and item[2].tick < 0:
        _welcome(item, returning, stage)
        return True
    if isinstance(item[2], Done) and item[2].tick != stage.scenario.ticks:
        raise stage.listener.intrusion(item[0], "out of turn")
    stage.listener.enter(item, max(0, arrived_ns))
    if isinstance(item[2], Done):
        stage.barrier.heard(issuer_of(item[0]))
    stage.registry.note([item[2]])
    stage.run_recorder.note(item, max(0, arrived_ns))
    return False


def _welcome(item: ReceivedMessage, awaited: set[str], stage: RunContext) -> None:
    """A process says that it is ready, if it is awaited."""
    name = issuer_of(item[0])
    if name not in awaited:
        raise stage.listener.intrusion(item[0], "out of turn")
    awaited.discard(name)


def _next(bus: Bus) -> Sample:
    while True:
        arrival = bus.next_before(bus.now_unix_ns() + 1_000_000_000)
        if arrival is not None:
            return arrival


def _say(bus: Bus, stage: RunContext, payload: bytes) -> None:
    stage.barrier.words.say(CLOCK, payload)
    bus.put(CLOCK, payload)


def _stop(bus: Bus, stage: RunContext, tick: int, t_ns: int) -> None:
    _say(bus, stage, codec.encode(Clock(tick, t_ns, "stop", {})))
