"""The lockstep clock, as the simulation conducts it: the same loop on every transport."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from fleet.config.scenario import Scenario
from fleet.faults.lifecycle import LifecycleChange
from fleet.faults.rules import Rule
from fleet.model.words import ClockState
from fleet.node.node import RestartState
from fleet.protocol import codec
from fleet.protocol.messages import Clock
from fleet.simulation.pace import Pace
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.run_recorder import Manifest, RunRecorder, manifest
from fleet.transport.interface import ReceivedMessage, Transport


class RunContext(Protocol):
    """What the clock needs of the run that it conducts."""

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
    def transport(self) -> Transport:
        """What reaches the participants."""
        ...

    def new_plan(self, tick: int, plan: tuple[Rule, ...] | None = None) -> tuple[Rule, ...] | None:
        """The fault plan from this tick on, if the operator has changed it; or `plan`, if not."""
        ...

    def carry_out(self, change: LifecycleChange, restart: RestartState | None) -> None:
        """Kill, stop or continue a process, or start it again."""
        ...


def conduct_lockstep(run: RunContext, pace: Pace | None = None) -> Iterator[int]:
    """Grant tick after tick, each once everything of the one before is there; yields their times.

    What a tick left is worked up while the participants are busy with the next one. A tick begins
    when `pace` says so; until then the operator is listened to.
    """
    registry, run_recorder, transport = run.registry, run.run_recorder, run.transport
    tick_ns, last = run.scenario.tick_ns, run.scenario.ticks
    transport.await_ready(registry.schedule.nodes, 0)
    listed: Manifest = {}
    items: list[ReceivedMessage] = []
    for tick in range(last + 1):
        now_ns = tick * tick_ns
        plan = run.new_plan(tick)
        while pace is not None and not pace.due(now_ns):
            plan = run.new_plan(tick, plan)
        clock = _entered(run, tick, listed, plan)
        payload = codec.encode(clock)
        transport.grant(clock, payload)
        if tick > 0:
            transport.audit()
            run_recorder.close(tick - 1, now_ns - tick_ns, items)
            yield now_ns - tick_ns
        run_recorder.clock(clock, payload)
        heard = transport.collect()
        listed = manifest(heard)
        registry.note(item[2] for item in heard)
        items = heard + registry.unmanned(tick)
        run_recorder.vanished = registry.vanished(tick)
    transport.audit(last=True)
    run_recorder.close(last, last * tick_ns, items)
    yield last * tick_ns
    over = Clock(last, last * tick_ns, ClockState.STOP, {})
    transport.stop(over, codec.encode(over))


def _entered(run: RunContext, tick: int, listed: Manifest, plan: tuple[Rule, ...] | None) -> Clock:
    """Carry out what a tick brings, and return its grant."""
    for change, restart in run.registry.enter(tick, plan):
        run.carry_out(change, restart)
        if change.action == "restart":
            run.transport.await_ready([change.node], tick * run.scenario.tick_ns)
    return run.registry.clock(tick, listed, new_plan=plan is not None)
