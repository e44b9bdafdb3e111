"""The two clocks, as the range conducts them: lockstep and realtime."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import msgspec

from fleet.comms import codec
from fleet.comms.arrival import Arrival
from fleet.comms.attendance import LAST_WORDS_NS
from fleet.comms.gate import AHEAD_NS
from fleet.comms.keys import CLOCK, EVERYTHING, issuer_name, issuer_of
from fleet.comms.messages import Clock, Done
from fleet.comms.station import Revival
from fleet.comms.zenoh_bus import Bus
from fleet.model.faults.plan import FaultRule, plan_json
from fleet.model.faults.process import Change
from fleet.model.scenario import Scenario
from fleet.run.cast import Cast
from fleet.run.ear import Ear, FleetStoppedError, Words
from fleet.run.ledger import Item, Ledger, Manifest, manifest

EPOCH_LEAD_NS = 200_000_000
"""Realtime begins this long after everybody is ready, so that all have heard when."""


class Roll:
    """Who has been heard of, for whoever has to say whom the range waits for; `busy` if it does.

    `items` is what has come of the tick in work.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = frozenset(names)
        self.words = Words()
        self.waiting: set[str] = set(names)
        self.items: list[Item] = []
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


class Stage(Protocol):
    """What a clock needs of the run that it conducts."""

    @property
    def scenario(self) -> Scenario:
        """What is flown."""
        ...

    @property
    def cast(self) -> Cast:
        """Who takes part."""
        ...

    @property
    def ledger(self) -> Ledger:
        """Where everything is entered."""
        ...

    @property
    def roll(self) -> Roll:
        """Who is awaited."""
        ...

    @property
    def ear(self) -> Ear:
        """What hears."""
        ...

    def new_plan(self, tick: int) -> tuple[FaultRule, ...] | None:
        """The fault plan from this tick on, if the operator has changed it."""
        ...

    def carry_out(self, change: Change, revival: Revival | None) -> None:
        """Kill, stop or continue a process, or start it again."""
        ...


def conduct_lockstep(bus: Bus, stage: Stage, speed: float) -> Iterator[int]:
    """Grant tick after tick, each once everything of the one before is there; yields their times.

    What a tick left is worked up while the participants are busy with the next one.
    """
    scenario, cast, ledger, roll = stage.scenario, stage.cast, stage.ledger, stage.roll
    stage.ear.audit(_collect(bus, stage, -1, 0))
    begun_s = time.monotonic()
    heard, items = list[Item](), list[Item]()
    listed: Manifest = {}
    for tick in range(scenario.ticks + 1):
        now_ns = tick * scenario.tick_ns
        if speed > 0.0:
            time.sleep(max(0.0, begun_s + now_ns / 1e9 / speed - time.monotonic()))
        plan = stage.new_plan(tick)
        for change, revival in cast.enter(tick, plan):
            roll.expect([change.node] if change.action == "restart" else [])
            stage.carry_out(change, revival)
            stage.ear.audit(_collect(bus, stage, -1, now_ns))
        clock = cast.clock(tick, listed, new_plan=plan is not None)
        absent = {*clock.held, *clock.down}
        roll.expect(n for n in cast.roster.nodes if n not in absent)
        payload = codec.encode(clock)
        _say(bus, stage, payload)
        if tick > 0:
            stage.ear.audit(heard)
            ledger.close(tick - 1, now_ns - scenario.tick_ns, items)
            yield now_ns - scenario.tick_ns
        ledger.clock(clock, payload)
        heard = _collect(bus, stage, tick, now_ns)
        listed = manifest(heard)
        cast.note(item[2] for item in heard)
        items = heard + cast.unmanned(tick)
        ledger.vanished = cast.vanished(tick)
    end_ns = scenario.ticks * scenario.tick_ns
    heard += [i for a in bus.waiting(EVERYTHING) if (i := stage.ear.hear(a, end_ns))]
    stage.ear.audit(heard)
    ledger.close(scenario.ticks, end_ns, items)
    yield end_ns
    _stop(bus, stage, scenario.ticks, end_ns)


def _collect(bus: Bus, stage: Stage, tick: int, now_ns: int) -> list[Item]:
    """All messages of one tick: until everybody is done and all that they sent has come."""
    owed, roll = 0, stage.roll
    items = roll.items = list[Item]()
    while roll.waiting or owed > 0:
        item = stage.ear.hear(bus.take(EVERYTHING), now_ns)
        if item is None:
            continue
        items.append(item)
        owed -= 1
        message = item[2]
        if isinstance(message, Done):
            if issuer_of(item[0]) not in roll.waiting or message.tick != tick:
                raise stage.ear.intrusion(item[0], "out of turn")
            roll.heard(issuer_of(item[0]))
            owed += sum(message.sent.values()) + 1
    roll.busy = False
    return items


def conduct_realtime(bus: Bus, stage: Stage) -> Iterator[int]:
    """Set the epoch, then listen for as long as the run lasts; yields the time tick by tick."""
    scenario, cast, roll = stage.scenario, stage.cast, stage.roll
    while roll.waiting:
        item = stage.ear.hear(_next(bus), 0)
        if item is not None and isinstance(item[2], Done):
            _welcome(item, roll.waiting, stage)
    epoch_ns = bus.now_unix_ns() + EPOCH_LEAD_NS
    _announce(bus, stage, Clock(0, 0, "epoch", {}, epoch_ns), epoch_ns)
    roll.expect(cast.roster.nodes)
    returning: set[str] = set()
    for tick in range(scenario.ticks + 1):
        clock = _enter(bus, stage, tick, epoch_ns, returning)
        due_ns = epoch_ns + (tick + 1) * scenario.tick_ns
        while (arrival := bus.next_before(due_ns)) is not None:
            if _note(arrival, epoch_ns, stage, returning):
                plan = plan_json(cast.plan)
                again = Clock(tick, clock.t_ns, "epoch", {}, epoch_ns, plan=plan)
                _announce(bus, stage, again, epoch_ns)
        stage.ledger.vanished = cast.vanished(tick)
        for item in cast.unmanned(tick):
            stage.ledger.note(item, clock.t_ns)
        stage.ledger.tell_refused(clock.t_ns)
        roll.moved_s = time.monotonic()
        yield clock.t_ns
    _hear_last_words(bus, stage, epoch_ns, returning)
    _stop(bus, stage, scenario.ticks, scenario.ticks * scenario.tick_ns)


def _enter(bus: Bus, stage: Stage, tick: int, epoch_ns: int, returning: set[str]) -> Clock:
    """Carry out what a realtime tick brings, and tell everybody if it changes anything."""
    plan = stage.new_plan(tick)
    changes = stage.cast.enter(tick, plan)
    for change, revival in changes:
        stage.carry_out(change, revival)
        if change.action == "restart":
            returning.add(issuer_name(change.node))
    clock = stage.cast.clock(tick, {}, new_plan=plan is not None)
    if changes or plan is not None:
        _announce(bus, stage, msgspec.structs.replace(clock, state="plan"), epoch_ns)
    return clock


def _hear_last_words(bus: Bus, stage: Stage, epoch_ns: int, returning: set[str]) -> None:
    """Wait until everybody who is there has said that it is through.

    Who has been started again and was not ready in time has said nothing, and waits for the end.
    """
    roster, roll = stage.cast.roster, stage.roll
    roll.waiting -= {issuer_name(n) for n in (*roster.held, *roster.down)} | returning
    until_ns = bus.now_unix_ns() + LAST_WORDS_NS
    while roll.waiting and (arrival := bus.next_before(until_ns)) is not None:
        _note(arrival, epoch_ns, stage, returning)
    if roll.waiting:
        raise FleetStoppedError(f"no last message from {', '.join(sorted(roll.waiting))}")


def _announce(bus: Bus, stage: Stage, clock: Clock, epoch_ns: int) -> None:
    """Say what has been carried out by now; the log tells when that was, for whoever checks it."""
    payload, said_ns = codec.encode(clock), max(0, bus.now_unix_ns() - epoch_ns)
    _say(bus, stage, payload)
    stage.ear.know(clock, said_ns)
    stage.ledger.clock(clock, payload, said_ns)


def _note(arrival: Arrival, epoch_ns: int, stage: Stage, returning: set[str]) -> bool:
    """Enter a message; True if it is that a process, which has been started again, is ready."""
    arrived_ns = arrival.arrived_unix_ns - epoch_ns
    item = stage.ear.hear(arrival, arrived_ns + AHEAD_NS)
    if item is None:
        return False
    if isinstance(item[2], Done) and item[2].tick < 0:
        _welcome(item, returning, stage)
        return True
    if isinstance(item[2], Done) and item[2].tick != stage.scenario.ticks:
        raise stage.ear.intrusion(item[0], "out of turn")
    stage.ear.enter(item, max(0, arrived_ns))
    if isinstance(item[2], Done):
        stage.roll.heard(issuer_of(item[0]))
    stage.cast.note([item[2]])
    stage.ledger.note(item, max(0, arrived_ns))
    return False


def _welcome(item: Item, awaited: set[str], stage: Stage) -> None:
    """A process says that it is ready, if it is awaited."""
    name = issuer_of(item[0])
    if name not in awaited:
        raise stage.ear.intrusion(item[0], "out of turn")
    awaited.discard(name)


def _next(bus: Bus) -> Arrival:
    while True:
        arrival = bus.next_before(bus.now_unix_ns() + 1_000_000_000)
        if arrival is not None:
            return arrival


def _say(bus: Bus, stage: Stage, payload: bytes) -> None:
    stage.roll.words.say(CLOCK, payload)
    bus.put(CLOCK, payload)


def _stop(bus: Bus, stage: Stage, tick: int, t_ns: int) -> None:
    _say(bus, stage, codec.encode(Clock(tick, t_ns, "stop", {})))
