"""What the plays on both clocks share: the bus, who speaks on it, and waiting with a limit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import msgspec

from fleet.config.scenario import Scenario
from fleet.conformance.evidence import Evidence, SaidMessage
from fleet.conformance.scene import FOREIGN, PLAYED, PlayedUav
from fleet.model.types import COORDINATOR, Position
from fleet.model.words import ClockMode
from fleet.node.clock_words import READY
from fleet.node.join_info import plan_bytes
from fleet.protocol import codec
from fleet.protocol.messages import Clock, Done, Message
from fleet.protocol.topics import ABORT, CLOCK, EVERYTHING, issuer_name, issuer_of, topic_of
from fleet.transport.zenoh_bus import Bus

JOIN_CHECK_NS = 200_000_000
"""So often it is looked whether the UAV that is waited for is still to come."""
SETTLE_NS = 60_000_000
"""So long it is watched whether something happens that must not."""


class StalledError(Exception):
    """The UAV did not do in time what it has to; the play is over."""


class Play:
    """Plays to one UAV on one clock, and keeps the evidence."""

    def __init__(self, bus: Bus, scenario: Scenario, clock: ClockMode, patience_s: float) -> None:
        """It waits for `patience_s` at most for what has to come at once."""
        self.bus = bus
        self.scenario = scenario
        self.evidence = Evidence(scenario, FOREIGN, clock)
        self.played = {n: PlayedUav(n, scenario) for n in PLAYED}
        self.patience_ns = round(patience_s * 1e9)
        self.tick = READY
        self._counts: Counter[tuple[int, str]] = Counter()
        self.placed = False

    def perform(
        self, wait_s: float, listening: Callable[[], None], gone: Callable[[], bool]
    ) -> Evidence:
        """All of it; waits for the UAV for `wait_s` at most, once it is `listening`.

        Nobody waits any longer for a UAV that is `gone` before it has joined.
        """
        bus, realtime = self.bus, self.evidence.clock is ClockMode.REALTIME
        bus.stamp(EVERYTHING, own=False, marking=realtime)
        bus.announce()
        bus.offer_plan(lambda: plan_bytes(self.evidence.clock, self.scenario))
        listening()
        try:
            self._await_ready(round(wait_s * 1e9), gone)
            self.act()
        except StalledError as error:
            self.evidence.stalled = str(error)
        self._stop()
        return self.evidence

    def act(self) -> None:
        """What is played once the UAV is ready; raises StalledError."""
        raise NotImplementedError

    def _await_ready(self, wait_ns: int, gone: Callable[[], bool]) -> None:
        until_ns = self.bus.now_unix_ns() + wait_ns
        while True:
            look_ns = self.bus.now_unix_ns() + JOIN_CHECK_NS
            try:
                message = self.hear(min(until_ns, look_ns), "it did not say that it is ready")
            except StalledError:
                if gone() or look_ns >= until_ns:
                    raise
                continue
            if isinstance(message, Done):
                break
            until_ns = min(until_ns, self.bus.now_unix_ns() + self.patience_ns)
        self.evidence.alive_when_ready = self.bus.is_alive(issuer_name(FOREIGN))

    def hear(self, until_unix_ns: int, missing: str) -> Message | None:
        """The next thing from the UAV; raises StalledError with what is missing if none comes."""
        while (sample := self.bus.next_before(until_unix_ns)) is not None:
            if issuer_of(sample.topic) == "sim":
                if sample.topic == ABORT:
                    raise StalledError("somebody aborted the run")
                continue
            return self.evidence.hear(self.tick, sample)
        raise StalledError(missing)

    def settle(self) -> list[Message]:
        """What comes within a moment, in which nothing should."""
        heard = len(self.evidence.heard)
        try:
            until_ns = self.bus.now_unix_ns() + SETTLE_NS
            while True:
                self.hear(until_ns, "")
        except StalledError:
            return [h.message for h in self.evidence.heard[heard:] if h.message]

    def numbered(self, message: Message, t_ns: int) -> Message:
        """A message with the next number of its issuer and class."""
        counted = message.id, message.kind
        self._counts[counted] += 1
        return msgspec.structs.replace(message, seq=self._counts[counted] - 1, t_ns=t_ns)

    def bring(self, message: Message, label: str = "", *, listed: bool = True) -> None:
        """Say something in the name of a participant that is played."""
        place = self._place(message.id) if self.placed else None
        payload = codec.encode(message)
        self.bus.put(topic_of(message), payload, place)
        now_ns = self.bus.now_unix_ns()
        self.evidence.said.append(SaidMessage(message, payload, listed, label, place, now_ns))

    def say(self, message: Message, t_ns: int, label: str = "", *, listed: bool = True) -> Message:
        """Number a message, and say it."""
        numbered = self.numbered(message, t_ns)
        self.bring(numbered, label, listed=listed)
        return numbered

    def _place(self, number: int) -> Position:
        if number == COORDINATOR:
            return self.scenario.coordination.position_ned_m
        return self.played[number].position_ned_m

    def grant(self, clock: Clock) -> None:
        """Say the clock."""
        self.evidence.grants.append(clock)
        self.bus.put(CLOCK, codec.encode(clock))

    def _stop(self) -> None:
        """Say that it is over, and see whether the UAV leaves."""
        last = self.evidence.grants[-1] if self.evidence.grants else Clock(0, 0, "stop", {})
        over = msgspec.structs.replace(last, state="stop", expected={}, held=(), plan="")
        self.bus.put(CLOCK, codec.encode(over))
        until_ns = self.bus.now_unix_ns() + self.patience_ns
        while self.bus.is_alive(issuer_name(FOREIGN)):
            if self.bus.now_unix_ns() > until_ns:
                self.evidence.left = False
                return
            self.settle()
        self.evidence.left = True
