"""The vehicle: flies its plan, or the manoeuvre that a command put in its place."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fleet.config.scenario import Scenario, Uav
from fleet.model.conflict.tracks import (
    NO_COMMAND,
    ActiveManoeuvre,
    CommandId,
    StateReport,
    intent_of,
)
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.guidance import GUIDANCE_STEP_NS, FlightPlan, WayToGoal
from fleet.model.vehicle.intent import Intent
from fleet.model.words import Manoeuvre
from fleet.protocol.messages import Command, Truth
from fleet.protocol.surveillance import manoeuvre_of, state_of

NEVER_NS = 2**63


@dataclass(frozen=True, slots=True)
class ScheduledManoeuvre:
    """An accepted command: what it is, when it starts and when it lapses."""

    command_id: CommandId
    manoeuvre: ActiveManoeuvre | None
    start_ns: int
    end_ns: int


def scheduled_manoeuvre(
    command: Command, accepted_ns: int, clock_shift_ns: int = 0
) -> ScheduledManoeuvre:
    """The order that an accepted command makes; it never starts before it was accepted.

    The command's times are read by the UAV's own clock, which is ahead by `clock_shift_ns`.
    """
    manoeuvre = None
    if command.manoeuvre != Manoeuvre.RESUME:
        told = (command.heading_rad, command.climb_mps, command.level_down_m, command.speed_mps)
        manoeuvre = manoeuvre_of(command.manoeuvre, *told)
    start_ns = max(command.start_ns - clock_shift_ns, accepted_ns)
    end_ns = command.manoeuvre_end_ns - clock_shift_ns
    return ScheduledManoeuvre(
        CommandId(command.term, command.id, command.number), manoeuvre, start_ns, end_ns
    )


class Vehicle:
    """State, plan and orders of one UAV; time only moves forward, by `fly_to` or `hold_to`."""

    def __init__(
        self, uav: Uav, scenario: Scenario, truth: Truth | None = None, now_ns: int = 0
    ) -> None:
        """At the start of its plan; or where `truth` says, if its process starts again."""
        self.id = uav.id
        self.now_ns = now_ns
        self.state: State = state_of(truth) if truth else uav.state()
        self._pilot = scenario.pilot(uav.id, uav.speed_mps)
        self._tick_ns = scenario.tick_ns
        self._step_ns = min(GUIDANCE_STEP_NS, scenario.tick_ns)
        self._inherited: Setpoint | None = None
        plan = uav.plan(truth.waypoint_index if truth else 0)
        if truth:
            speed_mps = truth.commanded_speed_mps or uav.speed_mps
            self._inherited = Setpoint(
                truth.commanded_heading_rad, truth.commanded_climb_mps, speed_mps
            )
        self.plan = self._pilot.advance(plan, self.state, self.state)
        self._to_goal: WayToGoal | None = None
        self._wanted: Setpoint | None = None
        self._foreseen: tuple[FlightPlan, FlightPlan] | None = None
        self._told: Intent | None = None
        self._pending: ScheduledManoeuvre | None = None
        self._active: ScheduledManoeuvre | None = None

    def fly_to(self, time_ns: int) -> None:
        """Fly to a time, switching exactly when an order starts or lapses."""
        self._inherited = None
        while self.now_ns < time_ns:
            self._switch()
            step_end_ns = self.now_ns + self._step_ns
            self._hold(self.commanded(), min(time_ns, step_end_ns, self._next_switch_ns()))
        self._switch()

    def hold_to(self, time_ns: int) -> None:
        """Fly to a time with nobody at the controls: the last command is held.

        That of the aircraft, if the process has just been started again and then stopped.
        """
        told = self._inherited or self.commanded()
        self._inherited = None
        while self.now_ns < time_ns:
            self._hold(told, min(time_ns, self.now_ns + self._tick_ns))
        self._switch()

    def obey(self, scheduled: ScheduledManoeuvre) -> None:
        """Take an order: it replaces any that waits, and the one in force when it starts."""
        self._pending = scheduled
        self._switch()

    @property
    def manoeuvre(self) -> ActiveManoeuvre | None:
        """The manoeuvre in force."""
        return self._active.manoeuvre if self._active else None

    @property
    def command_id(self) -> CommandId:
        """The command in force (all zero: none)."""
        return self._active.command_id if self._active else NO_COMMAND

    def guidance(self) -> Setpoint:
        """What guidance commands now."""
        if self._wanted is None:
            self._wanted = self._pilot.guide(self.plan, self.state, self._way())
        return self._wanted

    def commanded(self) -> Setpoint:
        """What the flight controller is told now: guidance's command through the manoeuvre."""
        if self._active is None:
            return self.guidance()
        intent = self.flown()
        cruising = math.isnan(intent.speed_mps)
        speed_mps = self.guidance().speed_mps if cruising else intent.speed_mps
        return Setpoint(intent.heading_rad, intent.climb_mps, speed_mps)

    def flown(self) -> Intent:
        """Heading and climb of this moment, where the climb will level off; a manoeuvre's speed."""
        if self._told is None:
            self._told = self._tell()
        return self._told

    def report(self, state: State, time_ns: int) -> StateReport:
        """What it says of itself, given the state that it senses and the time that it reads."""
        ahead, way = self._ahead(), self._way()
        guidance = self._pilot.intent(self.plan, self.state, way, ahead).at(state.speed_mps)
        return StateReport(
            self.id, time_ns, state, guidance, ahead, self.manoeuvre, self.command_id
        )

    def _way(self) -> WayToGoal:
        """The way to where guidance flies from this state."""
        if self._to_goal is None:
            self._to_goal = self._pilot.to_goal(self.plan, self.state)
        return self._to_goal

    def _ahead(self) -> FlightPlan:
        """What there is to know of the plan: the same until its goal is another one."""
        goal = self._way().goal
        if self._foreseen:
            plan, ahead = self._foreseen
            if plan is self.plan and ahead.waypoints[0] == goal:
                return ahead
        ahead = self._pilot.ahead(self.plan, self.state, goal)
        self._foreseen = self.plan, ahead
        return ahead

    def _tell(self) -> Intent:
        wanted = self.guidance()
        guidance = Intent(wanted.heading_rad, wanted.climb_mps, self.plan.waypoint[2])
        if self.manoeuvre is None:
            return guidance
        intent = intent_of(guidance, self.manoeuvre)
        climb_mps = self._pilot.model.climb_mps(intent, self.state)
        return Intent(
            intent.heading_rad, climb_mps, intent.level_down_m, speed_mps=intent.speed_mps
        )

    def _hold(self, told: Setpoint, until_ns: int) -> None:
        span_ns = until_ns - self.now_ns
        self.plan, self.state = self._pilot.hold(self.plan, self.state, told, span_ns)
        self._to_goal = self._wanted = self._told = None
        self.now_ns = until_ns

    def _switch(self) -> None:
        if self._pending and self._pending.start_ns <= self.now_ns:
            self._active = self._pending if self._pending.manoeuvre else None
            self._pending = self._told = None
        if self._active and self._active.end_ns <= self.now_ns:
            self._active = self._told = None

    def _next_switch_ns(self) -> int:
        if self._pending is None and self._active is None:
            return NEVER_NS
        times = [self._pending.start_ns] if self._pending else []
        if self._active:
            times.append(self._active.end_ns)
        return min(times)
