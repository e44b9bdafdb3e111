"""The loop of a participant in lockstep: a step for each tick that is granted."""

from __future__ import annotations

from fleet.config.scenario import Scenario
from fleet.faults.plan import plan_of
from fleet.model.words import ClockState
from fleet.node.broadcasts import Reception
from fleet.node.clock_words import FOREVER_NS, READY, clock_of
from fleet.node.gate import Gate
from fleet.node.own_radio import OwnRadio
from fleet.node.progress import ParticipantProgress
from fleet.node.runner import NodeRunner
from fleet.node.subscriptions import Subscriptions
from fleet.protocol import codec
from fleet.protocol.account import Account
from fleet.protocol.messages import Clock
from fleet.protocol.topics import CLOCK
from fleet.transport.zenoh_bus import Bus


def lockstep(runner: NodeRunner, bus: Bus, scenario: Scenario) -> None:
    """Step when a tick is granted and everything that its manifest lists has come."""
    gate = Gate(scenario)
    gate.latest_ns = FOREVER_NS  # who is held is behind the others; the manifest says what to take
    radio, subscriptions = OwnRadio(scenario, runner), Subscriptions(bus, runner.node.id, gate)
    progress = ParticipantProgress(bus)
    progress.intakes = lambda: subscriptions.intakes
    progress.lacked_room = lambda: subscriptions.lacked_room
    bus.listen(CLOCK)
    subscriptions.want(radio.suffixes)
    bus.announce()
    bus.put(*codec.on_wire(runner.done(READY, 0, Account())))
    last: int | None = None  # what was sent before this process came is not for it
    while True:
        progress.doing = "waiting for the clock"
        clock = _granted(bus, last, scenario.tick_ns)
        progress.at(clock.tick, "taking in")
        if clock.state == ClockState.STOP:
            return
        if clock.plan:
            runner.replan(plan_of(clock.plan))
        for arrival, message in subscriptions.take(None if last is None else clock):
            if radio.hears(message, arrival.place):
                place = arrival.place
                runner.accept(Reception(arrival.topic, arrival.payload, message, place=place))
        last = clock.tick
        if runner.node.id in clock.held:
            continue
        progress.doing = runner.node.doing
        messages, cell = runner.step(clock.t_ns), radio.cell
        radio.move()
        subscriptions.want(radio.suffixes)
        if cell != radio.cell:
            bus.retract(cell)
        place, sent = radio.place, [codec.on_wire(message, radio.cell) for message in messages]
        for message, (topic, payload) in zip(messages, sent, strict=True):
            bus.put(topic, payload, place, round_ns=runner.round_ns_with(message))
        bus.put(*codec.on_wire(runner.done(clock.tick, clock.t_ns, Account(sent))))


def _granted(bus: Bus, last: int | None, tick_ns: int) -> Clock:
    """The grant of the next tick, or the end of the run; what else is on that topic is ignored.

    (It is not the simulation's, and the simulation ends the run over it.)
    """
    while True:
        clock = clock_of(bus.take(CLOCK))
        if clock is None:
            continue
        follows = last is None or clock.tick == last + 1
        if clock.state == ClockState.STOP or (follows and clock.t_ns == clock.tick * tick_ns):
            return clock
