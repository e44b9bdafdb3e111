"""The simulation of a run as the victim: what it hears it counts, measures, shows and sums up."""

from __future__ import annotations

import contextlib

import msgspec

from fleet.analysis.result import result_of
from fleet.errors import FleetStoppedError
from fleet.faults.plan import plan_json
from fleet.live.view import LiveView
from fleet.node.gate import FUTURE_TOLERANCE_NS, Gate
from fleet.protocol.sample import Sample
from fleet.simulation.listener import Listener, OwnMessages
from fleet.simulation.live_feed import LinkCount, LiveFeed, LiveFrame
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.run_recorder import RunRecorder
from fleet.transport.interface import ReceivedMessage
from tests.hostile.scene import STEPS, Moment

TICK_INPUTS = 4
"""So many messages are heard in a tick."""


class _Counted:
    """Where records go: nowhere."""

    def write(self, topic: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """As a recorder that is never full."""


class Ear:
    """The simulation at a moment of a run, on either clock."""

    def __init__(self, moment: Moment, *, realtime: bool = False) -> None:
        self._moment, self._realtime = moment, realtime
        self._ticks, self._heard = STEPS, 0
        self.now_ns = 0

    @property
    def exhausted(self) -> bool:
        """Whether there is nothing more to hear."""
        return self._ticks >= STEPS

    def begin_anew(self) -> None:
        """From the same moment as ever."""
        scenario = self._moment.scenario
        self._ticks, self._heard = 0, 0
        self.now_ns = self._moment.begin * scenario.tick_ns
        self._recorder = RunRecorder(scenario, _Counted())
        self._feed = LiveFeed()
        self._recorder.watcher = self._feed.add
        self._registry = ProcessRegistry(scenario)
        gate = Gate(scenario, rising=self._realtime)
        self._listener = Listener(gate, self._recorder, OwnMessages(), scenario.tick_ns)
        self._view = LiveView(scenario)
        self._items: list[ReceivedMessage] = []

    def abandon(self) -> None:
        """It is not to be used any more as it is."""
        self._ticks = STEPS

    def due(self) -> list[ReceivedMessage]:
        """What was said in this tick."""
        return self._moment.flown[0][self._moment.begin + self._ticks]

    def number_due(self, topic: str) -> int | None:
        """The number of a message of that topic which is due now."""
        return next((m.seq for other, _, m in self.due() if other == topic), None)

    def hears(self, _topic: str) -> bool:
        """It hears everything."""
        return True

    def take(self, sample: Sample, together: int = 1) -> bool:
        """Hear a message, so many times more of them in a tick; whether the run may go on."""
        try:
            item = self._listener.hear(sample, self.now_ns + FUTURE_TOLERANCE_NS)
            if item is not None:
                self._enter(item)
        except FleetStoppedError:
            item = None
        self._heard += 1
        if self._heard % (TICK_INPUTS * together) == 0:
            self._close()
        return item is not None

    def _enter(self, item: ReceivedMessage) -> None:
        if self._realtime:
            try:
                self._listener.enter(item, self.now_ns)
            finally:  # what does not end the run is entered, and all else might be
                self._registry.note([item[2]])
                self._recorder.note(item, self.now_ns)
            return
        self._registry.note([item[2]])
        self._items.append(item)

    def _close(self) -> None:
        """End a tick: its accounts, its digest, and what viewers are shown of it."""
        items = self._items + self.due()
        self._items = []
        tick = self._moment.begin + self._ticks
        with contextlib.suppress(FleetStoppedError):  # an intruder may give a fitting account
            self._listener.audit(items)
        self._recorder.close(tick, self.now_ns, items)
        self._ticks += 1
        self.now_ns += self._moment.scenario.tick_ns
        if self._ticks % 16 == 0:
            self._show()

    def _show(self) -> None:
        """What a viewer sees, and what the run comes to."""
        frames: list[bytes] = []
        request = msgspec.msgpack.encode({"after": 0, "whole": True})
        self._feed._take(request, frames.append)
        self._feed.serve(self._frame)
        self._view.take(msgspec.msgpack.decode(frames[0], type=LiveFrame))
        msgspec.json.encode(result_of(self._recorder, self._moment.scenario.fault))

    def _frame(
        self,
        states: tuple[tuple[str, bytes], ...],
        events: tuple[tuple[int, str, bytes], ...],
        links: tuple[LinkCount, ...],
        *,
        whole: bool,
    ) -> LiveFrame:
        plan = plan_json(self._moment.scenario.fault)
        return LiveFrame(0, self.now_ns, states, events, links, plan, (), (), scenario="" * whole)
