"""The vehicle: flies its plan, or the escape that a command put in its place."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.comms.messages import Cmd
from fleet.model.flight import Command, State, fly
from fleet.model.guidance import advance, guide
from fleet.model.scenario import Scenario, Uav
from fleet.model.tracks import NO_COMMAND, CommandId, Escape, Report, aim_of
from fleet.model.trajectory import Aim
from fleet.model.units import to_s


@dataclass(frozen=True, slots=True)
class Order:
    """An accepted command: what it is, when it starts and when it lapses."""

    command: CommandId
    escape: Escape | None
    start_ns: int
    end_ns: int


def order_of(cmd: Cmd, accepted_ns: int) -> Order:
    """The order that an accepted command makes; it never starts before it was accepted."""
    escape = None
    if cmd.manoeuvre != "resume":
        escape = Escape(cmd.manoeuvre, cmd.heading_rad, cmd.climb_mps)
    start = max(cmd.start_ns, accepted_ns)
    return Order(CommandId(cmd.term, cmd.id, cmd.number), escape, start, cmd.escape_end_ns)


class Vehicle:
    """State, plan and orders of one UAV; time only moves forward, by `fly_to`."""

    def __init__(self, uav: Uav, scenario: Scenario) -> None:
        self.id = uav.id
        self.now_ns = 0
        self.state: State = uav.state()
        self._limits = scenario.limits()
        self._settings = scenario.guidance_settings(uav.speed_mps)
        self._tick_ns = scenario.tick_ns
        self.plan = advance(uav.plan(), self.state, self._settings)
        self._wanted: Command | None = None
        self._pending: Order | None = None
        self._active: Order | None = None

    def fly_to(self, time_ns: int) -> None:
        """Fly to a time, switching exactly when an order starts or lapses."""
        while self.now_ns < time_ns:
            self._switch()
            until = min(time_ns, self.now_ns + self._tick_ns, self._next_switch_ns())
            dt_s = to_s(until - self.now_ns)
            self.state = fly(self.state, self.commanded(), self._limits, dt_s)
            self.plan = advance(self.plan, self.state, self._settings)
            self._wanted = None
            self.now_ns = until
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
            self._wanted = guide(self.plan, self.state, self._settings, self._limits)
        return self._wanted

    def commanded(self) -> Command:
        """What the flight controller is told now: guidance's command through the escape."""
        wanted = self.guidance()
        if self._active is None:
            return wanted
        aim = aim_of(Aim(wanted.heading_rad, wanted.climb_mps), self._active.escape)
        return Command(aim.heading_rad, aim.climb_mps, wanted.speed_mps)

    def report(self) -> Report:
        """What it broadcasts of itself."""
        wanted = self.guidance()
        guidance = Aim(wanted.heading_rad, wanted.climb_mps, self.plan.waypoint[2])
        return Report(
            self.id, self.now_ns, self.state, guidance, self.plan, self.escape, self.command
        )

    def _switch(self) -> None:
        if self._pending and self._pending.start_ns <= self.now_ns:
            self._active = self._pending if self._pending.escape else None
            self._pending = None
        if self._active and self._active.end_ns <= self.now_ns:
            self._active = None

    def _next_switch_ns(self) -> int:
        times = [self._pending.start_ns] if self._pending else []
        if self._active:
            times.append(self._active.end_ns)
        return min(times, default=2**63)
