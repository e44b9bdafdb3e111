"""Who takes part in each tick: process faults, what the dead leave behind, and the plan in force.

The same for every bus: the zenoh bus carries the changes out as signals, the in-memory bus by
leaving node runners out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import msgspec

from fleet.config.scenario import Scenario
from fleet.config.traffic import participants, uavs_of
from fleet.faults.lifecycle import LifecycleChange, LifecycleSchedule
from fleet.faults.plan import plan_json
from fleet.faults.rules import Rule
from fleet.model.conflict.tracks import CommandId
from fleet.model.vehicle.flight import Setpoint
from fleet.model.vehicle.intent import Intent
from fleet.model.words import ClockState, Mode
from fleet.node.node import RestartState
from fleet.protocol import codec
from fleet.protocol.messages import Clock, Message, PersistentState, Truth
from fleet.protocol.surveillance import Flown, state_of, truth_of
from fleet.simulation.run_recorder import Manifest
from fleet.transport.interface import ReceivedMessage

NO_UAVS: frozenset[int] = frozenset()


class ProcessRegistry:
    """Presence, memories and unmanned aircraft of a run, tick by tick."""

    def __init__(self, scenario: Scenario) -> None:
        self.plan: tuple[Rule, ...] = scenario.fault
        self.schedule = LifecycleSchedule(participants(scenario), scenario.fault, scenario.tick_ns)
        self.tick = 0
        self._scenario = scenario
        self._tick_ns = scenario.tick_ns
        self._uavs = {u.id: u for u in uavs_of(scenario)}
        self._truths: dict[int, Truth] = {}
        self._memories: dict[int, PersistentState] = {}
        self._begun: set[int] = set()

    def enter(
        self, tick: int, plan: Sequence[Rule] | None = None
    ) -> list[tuple[LifecycleChange, RestartState | None]]:
        """Enter a tick, from which `plan` may be in force: who comes and goes, in order."""
        self.tick = tick
        if plan is not None:
            self.plan = tuple(plan)
            self.schedule.replan(self.plan)
        changes = self.schedule.advance(tick)
        for change in changes:
            truth = self._truths.get(change.node)
            if change.action == "kill" and truth:
                self._truths[change.node] = _straight(truth)
        return [(c, self._restart_state(c.node, tick)) for c in changes]

    def clock(self, tick: int, expected: Manifest, *, new_plan: bool) -> Clock:
        """The grant of a tick, with who comes and goes."""
        return Clock(
            tick,
            tick * self._tick_ns,
            ClockState.RUN,
            expected,
            held=self.schedule.held,
            down=self.schedule.down,
            plan=plan_json(self.plan) if new_plan else "",
        )

    def note(self, messages: Iterable[Message]) -> None:
        """Keep what a process would find if it were started again.

        In realtime the last state of who is dead can come after its death: it flies on from there,
        but not on its command, and not again from where it has been flown away from.
        """
        truths, down = self._truths, self.schedule.down
        for message in messages:
            self._begun.add(message.id)
            if isinstance(message, Truth):
                if message.id in down:
                    self._note_last(message)
                else:
                    truths[message.id] = message
            elif isinstance(message, PersistentState):
                self._memories[message.id] = message

    def _note_last(self, truth: Truth) -> None:
        known = self._truths.get(truth.id)
        if known is None or truth.t_ns > known.t_ns:
            self._truths[truth.id] = _straight(truth)

    def vanished(self, tick: int) -> frozenset[int]:
        """UAVs that are gone with their processes."""
        if not self.schedule.down:
            return NO_UAVS
        return frozenset(n for n in self.schedule.down if self.schedule.vanishes(n, tick))

    def unmanned(self, tick: int) -> list[ReceivedMessage]:
        """True states of the aircraft whose processes are stopped or dead."""
        if not (self.schedule.held or self.schedule.down):
            return []
        gone, out = self.vanished(tick), list[ReceivedMessage]()
        for mode, nodes in ((Mode.HELD, self.schedule.held), (Mode.UNMANNED, self.schedule.down)):
            for uav in nodes:
                if uav in gone or uav not in self._truths:
                    continue
                truth = self._flown(self._truths[uav], tick, mode)
                self._truths[uav] = truth
                out.append((*codec.on_wire(truth), truth))
        return out

    def _flown(self, truth: Truth, tick: int, mode: str) -> Truth:
        """The state one tick later, flown on the command that it holds."""
        uav = self._uavs[truth.id]
        speed_mps = truth.commanded_speed_mps or uav.speed_mps
        told = Setpoint(truth.commanded_heading_rad, truth.commanded_climb_mps, speed_mps)
        pilot, plan = self._scenario.pilot(uav.id, uav.speed_mps), uav.plan(truth.waypoint_index)
        plan, state = pilot.hold(plan, state_of(truth), told, self._tick_ns)
        wanted = Setpoint(truth.guidance_heading_rad, truth.guidance_climb_mps, uav.speed_mps)
        command_id = CommandId(truth.command_term, truth.command_issuer, truth.command_number)
        intent = Intent(
            told.heading_rad,
            told.climb_mps,
            truth.commanded_level_down_m,
            speed_mps=truth.commanded_speed_mps or math.nan,
        )
        now_ns = tick * self._tick_ns
        flown = Flown(mode, plan.active, wanted, intent, command_id)
        return truth_of(truth.id, tick, now_ns, state, flown)

    def found_by(self, node: int) -> RestartState | None:
        """What a new process would find in the place of one that has left by itself.

        None if that has not begun yet: then the new one is the first.
        """
        if node not in self._begun:
            return None
        flown = self.flown_alone(node)
        truth = flown[-1] if flown else self._truths.get(node)
        incarnation, t_ns = self.schedule.incarnation(node) + 1, (self.tick - 1) * self._tick_ns
        return RestartState(incarnation, max(t_ns, 0), self._memories.get(node), truth)

    def flown_alone(self, node: int) -> list[Truth]:
        """True states of an aircraft whose process has left, from its last one until now."""
        truth, out = self._truths.get(node), list[Truth]()
        if truth is None:
            return out
        truth = _straight(truth)
        for tick in range(truth.t_ns // self._tick_ns + 1, self.tick):
            truth = self._flown(truth, tick, Mode.UNMANNED)
            out.append(truth)
        return out

    def _restart_state(self, node: int, tick: int) -> RestartState | None:
        incarnation = self.schedule.incarnation(node)
        if not incarnation:
            return None
        t_ns = (tick - 1) * self._tick_ns
        return RestartState(incarnation, t_ns, self._memories.get(node), self._truths.get(node))


def _straight(truth: Truth) -> Truth:
    """A state that is flown on straight and level."""
    return msgspec.structs.replace(
        truth, commanded_heading_rad=truth.heading_rad, commanded_climb_mps=0.0
    )
