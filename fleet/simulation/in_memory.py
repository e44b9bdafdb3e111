"""The in-memory bus: the same node runners in one process, for studies and fast tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec

from fleet.agents.agent import Agent
from fleet.agents.resolvers import load_resolver
from fleet.config.scenario import Scenario
from fleet.config.traffic import participants, uavs_of
from fleet.coordinator.coordinator import Coordinator
from fleet.errors import FleetStoppedError
from fleet.faults.lifecycle import LifecycleChange
from fleet.faults.plan import FaultRule
from fleet.model.types import COORDINATOR, Position
from fleet.node.participant import lockstep_runner
from fleet.node.runner import Node, NodeRunner, RestartState
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.topics import is_broadcast, suffix_of
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.run_recorder import Manifest, ReceivedMessage, RunRecorder, manifest


class InMemoryRunners:
    """The node runners of a run by number; they come and go with the process faults."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._uavs = {u.id: u for u in uavs_of(scenario)}
        self.present = {n: self._runner(n, None) for n in participants(scenario)}

    def carry_out(self, change: LifecycleChange, restart: RestartState | None) -> None:
        """Let a node runner die or come again; a held one is merely not stepped."""
        if change.action == "kill":
            self.present.pop(change.node, None)
        elif change.action == "restart":
            self.present[change.node] = self._runner(change.node, restart)

    def replan(self, plan: tuple[FaultRule, ...]) -> None:
        """Everybody goes by another fault plan."""
        self._scenario = msgspec.structs.replace(self._scenario, fault=plan)
        for runner in self.present.values():
            runner.replan(plan)

    def hand_out(self, item: ReceivedMessage, place: Position | None) -> None:
        """Bring a message to everybody who hears its topic."""
        topic, payload, message = item
        suffix = suffix_of(topic)
        broadcast = is_broadcast(suffix)
        for number, runner in self.present.items():
            if suffix in runner.node.hears and not (broadcast and number == message.id):
                runner.accept(topic, payload, message, place=place)

    def _runner(self, number: int, restart: RestartState | None) -> NodeRunner:
        scenario = self._scenario
        node: Node
        if number == COORDINATOR:
            node = Coordinator(scenario, restart)
        else:
            node = Agent(self._uavs[number], scenario, load_resolver(scenario), restart)
        return lockstep_runner(node, scenario, restart)


NewPlan = Callable[[tuple[FaultRule, ...], int], tuple[FaultRule, ...] | None]
"""Given the plan so far and the tick: the plan from that tick on, or None if it stays."""


def run_in_memory(
    scenario: Scenario, run_recorder: RunRecorder, new_plan: NewPlan | None = None
) -> Iterator[int]:
    """Run a scenario tick by tick, yielding each tick's simulated time once it is in the ledger."""
    runners, registry = InMemoryRunners(scenario), ProcessRegistry(scenario)
    listed: Manifest = {}
    for tick in range(scenario.ticks + 1):
        now_ns = tick * scenario.tick_ns
        plan = new_plan(registry.plan, tick) if new_plan else None
        if plan is not None:
            runners.replan(plan)
        for change, restart in registry.enter(tick, plan):
            runners.carry_out(change, restart)
        clock = registry.clock(tick, listed, new_plan=plan is not None)
        run_recorder.clock(clock, codec.encode(clock))
        items, places = list[ReceivedMessage](), list[Position | None]()
        for number, runner in runners.present.items():
            if number not in clock.held:
                sent = _stepped(runner, tick, now_ns)
                items += sent
                places += [runner.place] * len(sent)
        for item, place in zip(items, places, strict=True):
            if item[2].kind in AUDIBLE:
                runners.hand_out(item, place)
        listed = manifest(items)
        registry.note(item[2] for item in items)
        items += registry.unmanned(tick)
        run_recorder.vanished = registry.vanished(tick)
        run_recorder.close(tick, now_ns, items)
        yield now_ns


def _stepped(runner: NodeRunner, tick: int, now_ns: int) -> list[ReceivedMessage]:
    """What a node runner sends in a tick; its errors end the run like a dead process."""
    try:
        sent = runner.step(now_ns)
        sent.append(runner.done(tick, now_ns, sent))
        return [(topic, payload, codec.decode(topic, payload)) for topic, payload in sent]
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        raise FleetStoppedError(f"process {runner.name} failed ({why})") from error
