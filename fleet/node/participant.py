"""Taking part in a run over zenoh: the loop that a UAV's and the coordinator's process share."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Annotated

import msgspec

from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.errors import BusError
from fleet.faults.channel import Channel
from fleet.faults.plan import plan_of
from fleet.model.conflict.contact import INCARNATION
from fleet.model.units import to_ns
from fleet.model.words import ClockMode, ClockState
from fleet.node.broadcasts import Reception
from fleet.node.delay_line import DelayLine
from fleet.node.gate import FUTURE_TOLERANCE_NS, Gate, RefusedError, credible
from fleet.node.intake import MOST_EARLY
from fleet.node.own_radio import OwnRadio
from fleet.node.progress import ParticipantProgress
from fleet.node.runner import (
    LockstepTiming,
    Node,
    NodeRunner,
    RealtimeTiming,
    RestartState,
)
from fleet.node.subscriptions import Subscriptions
from fleet.protocol import codec
from fleet.protocol.account import Account
from fleet.protocol.messages import Clock, Late, Message, Truth
from fleet.protocol.phases import phase_ns
from fleet.protocol.sample import Sample
from fleet.protocol.topics import ABORT, CLOCK, is_broadcast, issuer_name
from fleet.security.identity import Identity, identity_of
from fleet.transport.free_memory import GIVE_BACK_EVERY_S, give_back_free_memory
from fleet.transport.zenoh_bus import Bus, open_client_bus
from fleet.transport.zenoh_session import LEASE_S, SessionOptions

LATE_FRACTION = 0.1
"""A realtime step that begins later than this fraction of a tick is counted as late."""

STOPPED_TICKS = 5
"""A realtime process that is later than this has been stopped: it goes on from now."""

REALTIME_PATIENCE_S = 0.1
"""In realtime nobody waits longer to get rid of a message: it connects anew."""

FOREVER_NS = 2**62

READY = -1
"""The tick of which a process reports that it is ready."""


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
            bus.put(topic, payload, place, round_ns=_round_ns(runner, message))
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


def clock_of(arrival: Sample) -> Clock | None:
    """The simulation's word, if it is one that can be understood."""
    try:
        clock = codec.decode_clock(arrival.payload)
        if clock.plan:
            plan_of(clock.plan)
    except (ValueError, RecursionError):
        return None
    return None if arrival.flaw else clock


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
        round_ns = _round_ns(self._runner, message)
        self._bus.put(topic, payload, self._radio.place, round_ns=round_ns)


def _round_ns(runner: NodeRunner, message: Message) -> int:
    """How long the round took that was run in a step; its true state alone carries that."""
    return runner.node.round_ns if isinstance(message, Truth) else 0


def _await_stop(bus: Bus) -> None:
    while True:
        arrival = bus.next_before(FOREVER_NS)
        clock = clock_of(arrival) if arrival is not None and arrival.topic == CLOCK else None
        if clock is not None and clock.state == ClockState.STOP:
            return
