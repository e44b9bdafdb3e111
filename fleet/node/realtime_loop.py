"""The loop of a participant in realtime: each steps by its own wall clock."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config.scenario import Scenario
from fleet.faults.plan import plan_of
from fleet.model.conflict.contact import INCARNATION
from fleet.model.units import to_ns
from fleet.model.words import ClockState
from fleet.node.broadcasts import Reception
from fleet.node.clock_words import FOREVER_NS, READY, clock_of
from fleet.node.delay_line import DelayLine
from fleet.node.gate import FUTURE_TOLERANCE_NS, Gate, RefusedError
from fleet.node.intake import MOST_EARLY
from fleet.node.own_radio import OwnRadio
from fleet.node.progress import ParticipantProgress
from fleet.node.runner import NodeRunner
from fleet.protocol import codec
from fleet.protocol.account import Account
from fleet.protocol.messages import Clock, Late, Message
from fleet.protocol.phases import phase_ns
from fleet.protocol.sample import Sample
from fleet.protocol.topics import CLOCK, is_broadcast
from fleet.transport.free_memory import GIVE_BACK_EVERY_S, give_back_free_memory
from fleet.transport.zenoh_bus import Bus

LATE_FRACTION = 0.1
"""A realtime step that begins later than this fraction of a tick is counted as late."""

STOPPED_TICKS = 5
"""A realtime process that is later than this has been stopped: it goes on from now."""


def realtime(
    runner: NodeRunner, bus: Bus, scenario: Scenario, line: DelayLine, incarnation: int = 0
) -> None:
    """Step on the wall clock from the common epoch; late steps are reported, never hidden."""
    progress = ParticipantProgress(bus)
    progress.doing = "flying in realtime"
    bus.stamp(CLOCK)
    loop = _Realtime(runner, bus, scenario, line, incarnation)
    progress.lacked_room = lambda: loop.lacked_room
    loop.subscribe()
    bus.announce()
    bus.put(*codec.on_wire(runner.done(READY, 0, Account())))
    loop.run()


class _Realtime:
    """The realtime loop of one process; a context of its own for what it must keep."""

    def __init__(
        self, runner: NodeRunner, bus: Bus, scenario: Scenario, line: DelayLine, incarnation: int
    ) -> None:
        self._runner = runner
        self._radio = OwnRadio(scenario, runner)
        self._suffixes: Sequence[str] = ()
        self._bus = bus
        self._line = line
        self._tick_ns = scenario.tick_ns
        self._ticks_between_trims = max(1, to_ns(GIVE_BACK_EVERY_S) // scenario.tick_ns)
        self._phase_ns = line.phase_ns = phase_ns(runner.node.id, scenario.tick_ns)
        self._last = scenario.ticks
        self._epoch_ns = 0
        self._tick = 0
        self._gate = Gate(scenario, rising=True)
        self._sent = Account()
        self._late = incarnation * INCARNATION
        self._early: list[Sample] = []
        self.lacked_room = 0

    def subscribe(self) -> None:
        """To what is within reach by now; ahead of need by more than a subscription takes."""
        wanted, before = self._radio.suffixes, self._suffixes
        if wanted is before:
            return
        for suffix in wanted:
            if suffix not in before:
                self._bus.stamp(f"*/{suffix}", own=not is_broadcast(suffix))
        for suffix in before:
            if suffix not in wanted:
                self._bus.leave(f"*/{suffix}")
        self._suffixes = wanted

    def run(self) -> None:
        """Until the simulation stops the run."""
        while self._tick <= self._last:
            due_ns = self._due_ns() if self._epoch_ns else FOREVER_NS
            arrival = self._bus.next_before(due_ns)
            if arrival is None:
                self._step(self._bus.now_unix_ns() - due_ns)
            elif arrival.topic != CLOCK:
                self._accept(arrival)
            elif not self._obey(clock_of(arrival)):
                return
        end_ns = self._last * self._tick_ns
        self._bus.put(*codec.on_wire(self._runner.done(self._last, end_ns, self._sent)))
        _await_stop(self._bus)

    def _due_ns(self) -> int:
        """Unix time of the next step."""
        return self._epoch_ns + self._tick * self._tick_ns + self._phase_ns

    def _obey(self, clock: Clock | None) -> bool:
        """Take in a message of the simulation's clock; False if it is over."""
        if clock is None:
            return True
        if clock.plan:
            self._runner.replan(plan_of(clock.plan))
        if not self._epoch_ns and clock.epoch_unix_ns:
            self._epoch_ns = self._line.epoch_ns = clock.epoch_unix_ns
            since_ns = self._bus.now_unix_ns() - self._epoch_ns
            self._tick = max(0, -(-since_ns // self._tick_ns))
            for before in self._early:
                self._accept(before)
        return clock.state != ClockState.STOP

    def _accept(self, arrival: Sample) -> None:
        if not self._epoch_ns:
            if len(self._early) < MOST_EARLY:
                self._early.append(arrival)  # another process has begun already
            else:
                self.lacked_room += 1
            return
        put_ns, arrived_ns = arrival.put_unix_ns, arrival.arrived_unix_ns - self._epoch_ns
        self._gate.latest_ns = arrived_ns + FUTURE_TOLERANCE_NS
        try:
            message = self._gate.admit(arrival)
        except RefusedError:
            return
        if not self._radio.hears(message, arrival.place):
            return
        self._runner.accept(
            Reception(
                arrival.topic,
                arrival.payload,
                message,
                max(0, arrived_ns - phase_ns(message.id, self._tick_ns)),
                arrival.arrived_unix_ns - put_ns if put_ns else 0,
                arrival.place,
            )
        )

    def _step(self, behind_ns: int) -> None:
        if behind_ns > STOPPED_TICKS * self._tick_ns:
            self._tick = min(self._last, self._tick + behind_ns // self._tick_ns)
        now_ns = self._tick * self._tick_ns
        messages, cell = self._runner.step(now_ns), self._radio.cell
        self._radio.move()
        self.subscribe()
        if cell != self._radio.cell:
            self._bus.retract(cell)
        for message in messages:
            self._put(message)
        if behind_ns > LATE_FRACTION * self._tick_ns:
            report = Late(self._runner.node.id, self._late, now_ns, behind_ns)
            self._late += 1
            self._put(report)
        self._tick += 1
        if (self._tick + self._runner.node.id) % self._ticks_between_trims == 0:
            give_back_free_memory()

    def _put(self, message: Message) -> None:
        topic, payload = codec.on_wire(message, self._radio.cell)
        self._sent.add(topic, payload)
        round_ns = self._runner.round_ns_with(message)
        self._bus.put(topic, payload, self._radio.place, round_ns=round_ns)


def _await_stop(bus: Bus) -> None:
    while True:
        arrival = bus.next_before(FOREVER_NS)
        clock = clock_of(arrival) if arrival is not None and arrival.topic == CLOCK else None
        if clock is not None and clock.state == ClockState.STOP:
            return
