"""A run that is on, as the page's source: frames and changes go over the bus of the run."""

from __future__ import annotations

from typing import Any

import msgspec

from fleet.config.explaining import plan_of_tables
from fleet.errors import BusError
from fleet.faults.options import by_option
from fleet.faults.shorthand import from_now_on, rules_of, shorthands
from fleet.live.source import Change, ChangeOutcome
from fleet.protocol.topics import FAULT, PACE, SIMULATION, VIEW
from fleet.simulation.fault_control import FaultRequest, answer_of
from fleet.simulation.live_feed import LiveFrame, ViewRequest, view_frame_of
from fleet.simulation.pace import PaceRequest
from fleet.transport.zenoh_bus import Bus

FRAME_TIMEOUT_S = 5.0
CHANGE_TIMEOUT_S = 10.0
BROADCAST_S = 0.2
"""What shorthands that count broadcasts go by."""


class RunSource:
    """Implements `fleet.live.source.Source`."""

    recorded = False

    def __init__(self, bus: Bus, title: str) -> None:
        self.title = title
        self._bus = bus

    def frame(self, after: int, *, whole: bool = False) -> LiveFrame | None:
        """The newest frame; None if the run does not answer in time, as it may."""
        request = msgspec.msgpack.encode(ViewRequest(after, whole))
        reply = self._bus.ask(VIEW, request, FRAME_TIMEOUT_S)
        return None if reply is None else view_frame_of(reply)

    def past(self, _t_ns: int) -> LiveFrame | None:
        """A run tells its present alone."""
        return None

    def is_over(self) -> bool:
        """Whether the simulation has gone."""
        return not self._bus.is_alive(SIMULATION)

    def change(self, change: Change) -> ChangeOutcome:
        """Carry out what a viewer asks for."""
        if change.faults or change.clear or change.end:
            return self._change_plan(change)
        request = PaceRequest(change.paused, change.speed, change.steps)
        reply = self._bus.ask(PACE, msgspec.json.encode(request), CHANGE_TIMEOUT_S)
        if reply is None:
            return ChangeOutcome(
                good=False, text="the run does not answer: only lockstep can be paced"
            )
        return ChangeOutcome(good=not reply, text=reply.decode(errors="replace"))

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()

    def _change_plan(self, change: Change) -> ChangeOutcome:
        unknown = sorted(set(change.faults) - set(shorthands()))
        if unknown:
            return ChangeOutcome(good=False, text=f"no fault is called {', '.join(unknown)}")
        given = from_now_on(change.faults)
        tables: list[Any] = []
        try:
            tables = rules_of(given, BROADCAST_S)
            rules = plan_of_tables(tables)
        except ValueError as error:
            return ChangeOutcome(good=False, text=by_option(str(error), 0, tables))
        request = FaultRequest(rules, change.clear, change.end)
        reply = self._bus.ask(FAULT, msgspec.json.encode(request), CHANGE_TIMEOUT_S)
        if reply is None:
            return ChangeOutcome(good=False, text="the run does not answer")
        try:
            answer = answer_of(reply)
        except BusError as error:
            return ChangeOutcome(good=False, text=str(error))
        if answer.problem:
            return ChangeOutcome(good=False, text=by_option(answer.problem, answer.first, tables))
        return ChangeOutcome(good=True, text=f"from {answer.t_s:g} s (tick {answer.tick})")


def first_frame(source: RunSource, run: str, endpoint: str) -> LiveFrame:
    """A frame with the scenario; raises BusError if the run ends before it has one."""
    while not source.is_over():
        frame = source.frame(0, whole=True)
        if frame is not None:
            return frame
    raise BusError(f"run {run} does not answer at {endpoint}: it has ended")
