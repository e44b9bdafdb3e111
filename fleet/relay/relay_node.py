"""The node of a UAV that is flown elsewhere: each step is a question, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from fleet.config.scenario import Scenario, Uav
from fleet.faults.rules import Rule
from fleet.faults.sensors import Sensors
from fleet.model.conflict.tracks import Tracks
from fleet.model.equipment import broadcasts, hears
from fleet.model.types import Position
from fleet.model.units import to_ns
from fleet.node.base import BaseNode
from fleet.node.node import InboxMessage, RestartState
from fleet.protocol.messages import Command, Message, StateBroadcast, Truth
from fleet.protocol.surveillance import state_of
from fleet.relay.answers import AskedStep, answered_messages
from fleet.relay.questions import InboxItem, StepQuestion, moved

Ask = Callable[[StepQuestion], object]
"""Asks the program; the answer is of built-in types."""


class RelayNode(BaseNode):
    """Hears, sorts and numbers for a program that flies, elects and obeys.

    Its tracks say who is present, and what is implausible: the program is not told of that.
    """

    doing = "waiting for the answer of its program"
    takes_together = False

    def __init__(
        self, uav: Uav, scenario: Scenario, ask: Ask, restart: RestartState | None = None
    ) -> None:
        """`restart` is what a process that comes back finds; None at the first start."""
        super().__init__(uav.id, scenario, restart, Tracks(scenario.track_rules()))
        if not hears(uav.equipment):
            self.hears = ()
        self._ask = ask
        self._equipment = uav.equipment
        self._waypoints = len(uav.waypoints_ned_m)
        self._tick_ns = scenario.tick_ns
        self._broadcast_ns = to_ns(scenario.surveillance.broadcast_s)
        self._sensors = Sensors(scenario.fault, scenario.seed, uav.id)
        self._stepped_ns = restart.t_ns if restart else 0
        truth = restart.truth if restart else None
        self._place = truth.position_ned_m if truth else uav.state().position_ned_m

    @property
    def position_ned_m(self) -> Position:
        """Where its radio is: by the last true state that the program told."""
        return self._place

    def replan(self, plan: Sequence[Rule]) -> None:
        """Suffer from another fault plan from now on."""
        super().replan(plan)
        self._sensors.replan(plan)

    def hearing_ns(self, delivered_ns: int, now_ns: int) -> int:
        """What its clock shows when something is delivered: not before it can take it."""
        return self._local(self._handled_ns(delivered_ns, now_ns))

    def take_broadcast(self, message: StateBroadcast, sent: StateBroadcast, local_ns: int) -> None:
        """Take in a broadcast."""
        self._hear(message, sent, local_ns, answering=message.mandate_valid)

    def step(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[Message]:
        """Have the program fly to `now_ns` with what was delivered; returns what it sends."""
        self.round_ns = 0
        self._take_one_by_one(inbox, now_ns)
        told = [self._told(item, now_ns) for item in inbox if not self._doubted(item)]
        due = broadcasts(self._equipment) and self._due(now_ns, self._broadcast_ns)
        tick = now_ns // self._tick_ns
        present = tuple(sorted(self.tracks.present(self._local(now_ns))))
        answer = self._ask(StepQuestion(tick, now_ns, due, present, tuple(told)))
        commands = [(h.at_ns, h.message) for h in told if isinstance(h.message, Command)]
        asked = AskedStep(self.id, self._equipment, tick, now_ns, due, commands, self._waypoints)
        sent = answered_messages(answer, asked)
        truth = next(message for message in sent if isinstance(message, Truth))
        self._place = truth.position_ned_m
        self._stepped_ns = self._last_ns = now_ns
        known = (self._as_known(message, truth) for message in sent)
        return [self._numbered(message, tick) for message in known if message is not None]

    def _numbered(self, message: Message, tick: int) -> Message:
        seq = tick if isinstance(message, Truth) else self._next(type(message))
        return msgspec.structs.replace(message, seq=seq)

    def _handled_ns(self, delivered_ns: int, now_ns: int) -> int:
        """When it can act on what was delivered at a time; who was stopped does so now."""
        stopped = now_ns - self._stepped_ns > self._tick_ns
        return now_ns if stopped else max(delivered_ns, self._stepped_ns)

    def _doubted(self, item: InboxMessage) -> bool:
        sent = item.original
        return isinstance(sent, StateBroadcast) and (sent.id, sent.seq) in self.implausible

    def _told(self, item: InboxMessage, now_ns: int) -> InboxItem:
        """A message as the program is told of it: all times by the one clock that it knows."""
        at_ns = self._handled_ns(item.delivered_ns, now_ns)
        message = moved(item.message, at_ns - self._local(at_ns))
        return InboxItem(at_ns, message.kind, message)

    def _as_known(self, message: Message, truth: Truth) -> Message | None:
        """A message as its own clock and sensors have it; None if it does not know where it is."""
        if not self._clock.clean:
            message = moved(message, self._local(message.t_ns) - message.t_ns)
        if not isinstance(message, StateBroadcast) or self._sensors.clean:
            return message
        state = self._sensors.sense(state_of(truth), message.t_ns)
        if state is None:
            return None
        return msgspec.structs.replace(
            message,
            position_ned_m=state.position_ned_m,
            velocity_ned_mps=state.velocity_ned_mps,
            speed_mps=state.speed_mps,
            heading_rad=state.heading_rad,
            flight_path_rad=state.flight_path_rad,
        )
