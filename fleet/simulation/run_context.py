"""The context of a run over zenoh: its processes, and what the operator asks for."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial

import msgspec

from fleet.config.scenario import Scenario
from fleet.faults.lifecycle import LifecycleChange
from fleet.faults.plan import plan_json
from fleet.faults.rules import Rule
from fleet.model.words import ClockMode
from fleet.node.gate import Gate
from fleet.node.join_info import JoinInfo, plan_bytes
from fleet.node.node import RestartState
from fleet.protocol.topics import ABORT, FAULT, PACE, VIEW, issuer_name
from fleet.simulation.fault_control import FaultControl
from fleet.simulation.join_wait import JoinWait
from fleet.simulation.listener import Listener
from fleet.simulation.live_feed import LinkCount, LiveFeed, LiveFrame
from fleet.simulation.outages import OutageTracker
from fleet.simulation.pace import Pace
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.run_recorder import RunRecorder
from fleet.simulation.shortages import Shortages
from fleet.simulation.supervisor import ProcessSupervisor
from fleet.simulation.tick_barrier import TickBarrier
from fleet.simulation.watchdog import TokenLimits, Watchdog
from fleet.simulation.zenoh_transport import ZenohTransport
from fleet.transport.zenoh_bus import Bus


class ZenohRunContext:
    """Implements what the lockstep clock needs (`fleet.simulation.lockstep.RunContext`).

    The realtime clock, which zenoh alone has, goes by it too.
    """

    def __init__(
        self,
        bus: Bus,
        join_info: JoinInfo,
        run_recorder: RunRecorder,
        stall_s: float,
        *,
        uninterrupted: AbstractContextManager[object],
        external: bool = False,
    ) -> None:
        """`uninterrupted` holds interrupts off; `external`: others start the processes."""
        self.scenario: Scenario = join_info.scenario
        self.run_recorder = run_recorder
        self.registry = ProcessRegistry(self.scenario)
        numbers = list(self.registry.schedule.nodes)
        self.barrier = TickBarrier([issuer_name(n) for n in numbers])
        gate = Gate(self.scenario, rising=True)
        self.listener = Listener(gate, run_recorder, self.barrier.words, self.scenario.tick_ns)
        self.transport = ZenohTransport(bus, self.listener, self.barrier, numbers)
        self.outages = OutageTracker(self.scenario)
        self.supervisor = ProcessSupervisor(join_info, numbers, uninterrupted)
        realtime = join_info.clock == ClockMode.REALTIME
        tokens = TokenLimits(self.outages, join_info.lease_s) if realtime else None
        self.watchdog = Watchdog(bus, self.barrier, stall_s, self.supervisor, tokens)
        self._bus = bus
        self._join_info = join_info
        self._requests = FaultControl(self.scenario, processes=not external, realtime=realtime)
        self._feed, self._paced = LiveFeed(), not realtime
        self.pace = Pace()
        self.shortages = Shortages()
        for place, counting in ((FAULT, self._requests), (VIEW, self._feed), (PACE, self.pace)):
            self.shortages.watch(place, partial(getattr, counting, "lacked_room"))
        run_recorder.watcher = self._feed.add

    def start(self) -> None:
        """Start the processes of the fleet."""
        self.watchdog.start()
        self._bus.announce()
        self._listen()
        self.supervisor.start(self.watchdog.died)

    def invite(self, timeout_s: float) -> None:
        """Wait for processes that others start; nobody may join for so long."""
        self.watchdog.start(JoinWait(self._bus.run, self.barrier, timeout_s))
        self._bus.announce()
        self._bus.offer_plan(self._plan)
        self._listen()

    def _listen(self) -> None:
        """Take what operators and viewers ask."""
        self._requests.listen(self._bus)
        self._feed.listen(self._bus)
        if self._paced:
            self.pace.listen(self._bus)

    def _plan(self) -> bytes:
        """What those who join have to know; with what they find if they come in another's place."""
        info, registry = self._join_info, self.registry
        absent = self.outages.absent(registry.tick * self.scenario.tick_ns)
        restarts = {issuer_name(n): found for n in absent if (found := registry.found_by(n))}
        return plan_bytes(info.clock, self.scenario, info.lease_s, restarts)

    def dismiss(self, why: BaseException) -> None:
        """The run is cut short: tell everybody why, so that nobody stays."""
        said = str(why) or "the run was interrupted"
        self._bus.put(ABORT, f"the run has ended: {said}".encode())
        self._bus.retire()

    def ask_for_shortages(self) -> None:
        """Have the participants tell what they had no room for, before they leave.

        Where nobody was refused there are no strangers, who alone could send so much.
        """
        if self.run_recorder.rejected:
            self.shortages.ask(self._bus, [issuer_name(n) for n in self.registry.schedule.nodes])

    def stop(self) -> None:
        """End what was started."""
        self.watchdog.end()
        self.supervisor.stop()

    def new_plan(self, tick: int, plan: tuple[Rule, ...] | None = None) -> tuple[Rule, ...] | None:
        """The fault plan from this tick on, if the operator has changed it; answers viewers."""
        so_far = self.registry.plan if plan is None else plan
        changed = self._requests.new_plan(so_far, tick)
        self._feed.serve(partial(self._frame, tick, changed or so_far))
        return plan if changed is None else changed

    def _frame(
        self,
        tick: int,
        plan: tuple[Rule, ...],
        states: tuple[tuple[str, bytes], ...],
        events: tuple[tuple[int, str, bytes], ...],
        links: tuple[LinkCount, ...],
        *,
        whole: bool,
    ) -> LiveFrame:
        schedule, pace = self.registry.schedule, self.pace
        scenario = msgspec.json.encode(self.scenario).decode() if whole else ""
        return LiveFrame(
            tick,
            tick * self.scenario.tick_ns,
            states,
            events,
            links,
            plan_json(plan),
            tuple(schedule.held),
            tuple(schedule.down),
            paused=pace.paused,
            speed=pace.speed,
            paced=self._paced,
            scenario=scenario,
        )

    def carry_out(self, change: LifecycleChange, restart: RestartState | None) -> None:
        """Signal a process, or start it again."""
        match change.action:
            case "kill":
                self.supervisor.kill(change.node)
            case "stop":
                self.supervisor.hold(change.node)
            case "continue":
                self.supervisor.release(change.node)
            case "restart":
                scenario = msgspec.structs.replace(self.scenario, fault=self.registry.plan)
                join_info = replace(self._join_info, scenario=scenario, restart=restart)
                self.supervisor.restart(change.node, join_info)
