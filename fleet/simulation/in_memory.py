"""The transport in memory: the same node runners in one process, for studies and fast tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import msgspec

from fleet.agents.agent import Agent
from fleet.agents.resolvers import load_resolver
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.coordinator.coordinator import Coordinator
from fleet.errors import FleetStoppedError
from fleet.faults.lifecycle import LifecycleChange
from fleet.faults.plan import plan_of
from fleet.faults.rules import Rule
from fleet.model.radio import Ear, Earshot, RadioRange
from fleet.model.types import COORDINATOR, Position
from fleet.model.words import ClockState
from fleet.node.base import track_table
from fleet.node.broadcasts import BroadcastArrivals, Broadcasts, Portion, Reception, take_in
from fleet.node.node import Node, RestartState
from fleet.node.participant import lockstep_runner
from fleet.node.runner import NodeRunner
from fleet.protocol import codec
from fleet.protocol.account import Account
from fleet.protocol.cells import Cells
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import AddressedMessage, Clock, Message, StateBroadcast
from fleet.protocol.topics import topic_of
from fleet.simulation.lockstep import conduct_lockstep
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.run_recorder import RunRecorder
from fleet.transport.interface import ReceivedMessage


class MemoryTransport:
    """Implements `fleet.transport.interface.Transport`, for the runners of those who are there."""

    def __init__(self, radio: RadioRange, cells: Cells | None = None, *, recorded: bool) -> None:
        """What nobody records is encoded only if a fault plan may look at payloads."""
        self.runners: dict[int, NodeRunner] = {}
        self._radio, self._cells = radio, cells
        self._ears: dict[int, Ear] = {}
        self._recorded = self._encoded = recorded
        self._clock = Clock(-1, 0, ClockState.RUN, {})

    def start(self, number: int, runner: NodeRunner) -> None:
        """A process begins, or begins again."""
        self.runners[number] = runner
        self._ears[number] = Ear(runner.node.position_ned_m)
        self._look_who_reads()

    def kill(self, number: int) -> None:
        """A process is no more."""
        self.runners.pop(number, None)
        self._ears.pop(number, None)

    def await_ready(self, numbers: Iterable[int], now_ns: int) -> None:
        """Nothing to wait for."""

    def grant(self, clock: Clock, _payload: bytes) -> None:
        """Everybody steps when the tick is collected; here they take a new fault plan."""
        self._clock = clock
        if clock.plan:
            plan = plan_of(clock.plan)
            for runner in self.runners.values():
                runner.replan(plan)
            self._look_who_reads()

    def collect(self) -> list[ReceivedMessage]:
        """Step everybody who is not held, and hand out what they sent."""
        clock = self._clock
        items, places = list[ReceivedMessage](), list[Position | None]()
        stepping = [r for number, r in self.runners.items() if number not in clock.held]
        self._take_in(stepping, clock.t_ns)
        for runner in stepping:
            sent = self._stepped(runner, clock)
            items += sent
            places += [runner.place] * len(sent)
        earshot = self._earshot() if self._radio.limited else None
        broadcasts = Broadcasts(clock.t_ns)
        for (topic, payload, message), place in zip(items, places, strict=True):
            if message.kind in AUDIBLE:
                reception = Reception(topic, payload, message, place=place)
                if not (isinstance(message, StateBroadcast) and broadcasts.add(reception, message)):
                    self._hand_out(reception, earshot)
        if broadcasts.messages:
            self._hand_out_together(broadcasts, earshot)
        return items

    def _look_who_reads(self) -> None:
        """What is read by nobody need not be encoded."""
        self._encoded = self._recorded or any(r.reads_payloads for r in self.runners.values())

    def _take_in(self, runners: Iterable[NodeRunner], now_ns: int) -> None:
        """Let all take in together what reaches them together."""
        hearing, due = list[Node](), list[list[BroadcastArrivals]]()
        for runner in runners:
            its = runner.due_together(now_ns)
            if its:
                hearing.append(runner.node)
                due.append(its)
        take_in(hearing, due, now_ns)

    def _earshot(self) -> Earshot:
        """Who hears whom in the tick that has just been stepped."""
        sending: dict[int, Position] = {}
        for number, runner in self.runners.items():
            if number not in self._clock.held:
                place = sending[number] = runner.node.position_ned_m
                self._ears[number].move(place, self._radio.margin_m)
        return Earshot(self._radio, sending, {n: ear.place for n, ear in self._ears.items()})

    def audit(self, *, last: bool = False) -> None:
        """Nobody else can speak in another's name here."""

    def stop(self, clock: Clock, payload: bytes) -> None:
        """Nobody waits for it."""

    def _stepped(self, runner: NodeRunner, clock: Clock) -> list[ReceivedMessage]:
        """What a node runner sends in a tick; its errors end the run like a dead process."""
        try:
            messages = runner.step(clock.t_ns)
            cell = self._cells.name(runner.node.position_ned_m) if self._cells else ""
            if not self._encoded:
                return [(topic_of(m, cell), b"", m) for m in messages]
            sent = [codec.on_wire(m, cell) for m in messages]
            if not self._recorded:
                return _received(sent, messages)
            done = runner.done(clock.tick, clock.t_ns, Account(sent))
            messages.append(done)
            sent.append(codec.on_wire(done))
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            raise FleetStoppedError(f"process {runner.name} failed ({why})") from error
        return _received(sent, messages)

    def _hand_out(self, reception: Reception, earshot: Earshot | None) -> None:
        """Bring a message to everybody who hears its topic, and is within radio range."""
        message = reception.message
        suffix, issuer = message.suffix, message.id
        if isinstance(message, AddressedMessage):
            target = self.runners.get(message.target)
            reached = earshot is None or earshot.hears(issuer, message.target)
            if reached and target is not None and suffix in target.node.hears:
                target.accept(reception)
            return
        for number in self.runners if earshot is None else earshot.hearers(issuer):
            runner = self.runners[number]
            if number != issuer and suffix in runner.node.hears:
                runner.accept(reception)

    def _hand_out_together(self, broadcasts: Broadcasts, earshot: Earshot | None) -> None:
        """Bring what was broadcast in this tick to everybody who hears it."""
        suffix = broadcasts.messages[0].suffix
        hearing = {n: r for n, r in self.runners.items() if suffix in r.node.hears}
        if earshot is None:
            everything = Portion(broadcasts)
            for runner in hearing.values():
                runner.accept_together(everything)
            return
        heard: dict[int, list[int]] = {number: [] for number in hearing}
        for place, message in enumerate(broadcasts.messages):
            for number in earshot.hearers(message.id):
                if number in heard:
                    heard[number].append(place)
        for number, places in heard.items():
            if places:
                hearing[number].accept_together(Portion(broadcasts, places))


def _received(
    sent: Sequence[tuple[str, bytes]], messages: Sequence[Message]
) -> list[ReceivedMessage]:
    return [(topic, payload, m) for (topic, payload), m in zip(sent, messages, strict=True)]


NewPlan = Callable[[tuple[Rule, ...], int], tuple[Rule, ...] | None]
"""Given the plan so far and the tick: the plan from that tick on, or None if it stays."""


class MemoryRunContext:
    """Implements what the clock needs (`fleet.simulation.lockstep.RunContext`)."""

    def __init__(
        self, scenario: Scenario, run_recorder: RunRecorder, new_plan: NewPlan | None
    ) -> None:
        self.scenario = scenario
        self.run_recorder = run_recorder
        self.registry = ProcessRegistry(scenario)
        self.transport = MemoryTransport(
            scenario.radio(), scenario.cells(), recorded=run_recorder.keeps_record
        )
        self._uavs = {u.id: u for u in uavs_of(scenario)}
        self._table = track_table(scenario, len(self.registry.schedule.nodes))
        self._changed = new_plan
        for number in self.registry.schedule.nodes:
            self._start(number, None)

    def new_plan(self, tick: int, plan: tuple[Rule, ...] | None = None) -> tuple[Rule, ...] | None:
        """The fault plan from this tick on, if it is changed."""
        plan = self._changed(plan or self.registry.plan, tick) if self._changed else None
        if plan is not None:
            self.scenario = msgspec.structs.replace(self.scenario, fault=plan)
        return plan

    def carry_out(self, change: LifecycleChange, restart: RestartState | None) -> None:
        """Let a node runner die or come again; a held one is merely not stepped."""
        if change.action == "kill":
            self.transport.kill(change.node)
        elif change.action == "restart":
            self._start(change.node, restart)

    def _start(self, number: int, restart: RestartState | None) -> None:
        scenario = self.scenario
        node: Node
        row = self.registry.schedule.nodes.index(number)
        tracks = self._table.row(row) if self._table else None
        if number == COORDINATOR:
            node = Coordinator(scenario, restart, tracks)
        else:
            node = Agent(self._uavs[number], scenario, load_resolver(scenario), restart, tracks)
        runner = lockstep_runner(node, scenario, restart)
        runner.reporting = self.run_recorder.keeps_record
        self.transport.start(number, runner)


def run_in_memory(
    scenario: Scenario, run_recorder: RunRecorder, new_plan: NewPlan | None = None
) -> Iterator[int]:
    """Run a scenario tick by tick, yielding each tick's simulated time once it is recorded."""
    yield from conduct_lockstep(MemoryRunContext(scenario, run_recorder, new_plan))
