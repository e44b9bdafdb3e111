"""The vehicle: flies its plan, or the escape that a command put in its place."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fleet.comms.messages import Cmd, Truth
from fleet.comms.surveillance import escape_of, state_of
from fleet.model.aims import Aim
from fleet.model.flight import Command, State
from fleet.model.guidance import STEP_NS
from fleet.model.scenario import Scenario, Uav
from fleet.model.tracks import NO_COMMAND, CommandId, Escape, Report, aim_of


@dataclass(frozen=True, slots=True)
class Order:
    """An accepted command: what it is, when it starts and when it lapses."""

    command: CommandId
    escape: Escape | None
    start_ns: int
    end_ns: int


def order_of(cmd: Cmd, accepted_ns: int, clock_shift_ns: int = 0) -> Order:
    """The order that an accepted command makes; it never starts before it was accepted.

    The command's times are read by the UAV's own clock, which is ahead by `clock_shift_ns`.
    """
    escape = None
    if cmd.manoeuvre != "resume":
        told = (cmd.heading_rad, cmd.climb_mps, cmd.level_down_m, cmd.speed_mps)
        escape = escape_of(cmd.manoeuvre, *told)
    start_ns = max(cmd.start_ns - clock_shift_ns, accepted_ns)
    end_ns = cmd.escape_end_ns - clock_shift_ns
    return Order(CommandId(cmd.term, cmd.id, cmd.number), escape, start_ns, end_ns)


class Vehicle:
    """State, plan and orders of one UAV; time only moves forward, by `fly_to` or `hold_to`."""

    def __init__(
        self, uav: Uav, scenario: Scenario, truth: Truth | None = None, now_ns: int = 0
    ) -> None:
        """At the start of its plan; or where `truth` says, if its process starts again."""
        self.id = uav.id
        self.now_ns = now_ns
        self.state: State = state_of(truth) if truth else uav.state()
        self._pilot = scenario.pilot(uav.speed_mps)
        self._predictor = scenario.predictor()
        self._tick_ns = scenario.tick_ns
        self._inherited: Command | None = None
        plan = uav.plan(truth.waypoint_index if truth else 0)
        if truth:
            speed_mps = truth.commanded_speed_mps or uav.speed_mps
            self._inherited = Command(
                truth.commanded_heading_rad, truth.commanded_climb_mps, speed_mps
            )
        self.plan = self._pilot.advance(plan, self.state, self.state)
        self._wanted: Command | None = None
        self._told: Aim | None = None
        self._pending: Order | None = None
        self._active: Order | None = None

    def fly_to(self, time_ns: int) -> None:
        """Fly to a time, switching exactly when an order starts or lapses."""
        self._inherited = None
        while self.now_ns < time_ns:
            self._switch()
            step_end_ns = self.now_ns + min(STEP_NS, self._tick_ns)
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

    def obey(self, order: Order) -> None:
        """Take an order: it replaces any that waits, and the one in force when it starts."""
        self._pending = order
        self._switch()

    @property
    def escape(self) -> Escape | None:
        """The escape in force."""
        return self._active.escape if self._active else None

    @property
    def command(self) -> CommandId:
        """The command in force (all zero: none)."""
        return self._active.command if self._active else NO_COMMAND

    def guidance(self) -> Command:
        """What guidance commands now."""
        if self._wanted is None:
            self._wanted = self._pilot.guide(self.plan, self.state)
        return self._wanted

    def commanded(self) -> Command:
        """What the flight controller is told now: guidance's command through the escape."""
        aim = self.flown()
        cruising = math.isnan(aim.speed_mps)
        speed_mps = self.guidance().speed_mps if cruising else aim.speed_mps
        return Command(aim.heading_rad, aim.climb_mps, speed_mps)

    def flown(self) -> Aim:
        """Heading and climb of this moment, where the climb will level off; an escape's speed."""
        if self._told is None:
            self._told = self._tell()
        return self._told

    def report(self, state: State, time_ns: int) -> Report:
        """What it says of itself, given the state that it senses and the time that it reads."""
        guidance = self._pilot.aim(self.plan, self.state).at(state.speed_mps)
        ahead = self._pilot.ahead(self.plan, self.state)
        return Report(self.id, time_ns, state, guidance, ahead, self.escape, self.command)

    def _tell(self) -> Aim:
        wanted = self.guidance()
        guidance = Aim(wanted.heading_rad, wanted.climb_mps, self.plan.waypoint[2])
        if self.escape is None:
            return guidance
        aim = aim_of(guidance, self.escape)
        climb_mps = self._predictor.climb_mps(aim, self.state)
        return Aim(aim.heading_rad, climb_mps, aim.level_down_m, speed_mps=aim.speed_mps)

    def _hold(self, told: Command, until_ns: int) -> None:
        span_ns = until_ns - self.now_ns
        self.plan, self.state = self._pilot.hold(self.plan, self.state, told, span_ns)
        self._wanted = self._told = None
        self.now_ns = until_ns

    def _switch(self) -> None:
        if self._pending and self._pending.start_ns <= self.now_ns:
            self._active = self._pending if self._pending.escape else None
            self._pending = self._told = None
        if self._active and self._active.end_ns <= self.now_ns:
            self._active = self._told = None

    def _next_switch_ns(self) -> int:
        times = [self._pending.start_ns] if self._pending else []
        if self._active:
            times.append(self._active.end_ns)
        return min(times, default=2**63)
