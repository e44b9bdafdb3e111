"""Plays the wall clock: tells the epoch, and says what the script has at its time."""

from __future__ import annotations

from fleet.conformance import realtime_script as script
from fleet.conformance.play import Play, StalledError
from fleet.conformance.scene import FOREIGN
from fleet.conformance.script import garbage
from fleet.faults.plan import plan_json
from fleet.model.words import ClockState
from fleet.protocol.attendance import LAST_WORDS_NS
from fleet.protocol.messages import Clock, Done, Message
from fleet.protocol.phases import phase_ns
from fleet.protocol.topics import topic_of

AHEAD = "from the future"
_LEAD_NS = 200_000_000
"""The epoch is so far ahead when it is told."""


class RealtimePlay(Play):
    """Nobody waits for anybody; only the end has to come in time."""

    def act(self) -> None:
        """All ticks of the scenario; raises StalledError."""
        evidence, tick_ns = self.evidence, self.scenario.tick_ns
        evidence.plan = script.realtime_plan()
        self.say(self.played[1].broadcast(0), 0, "before the epoch")
        evidence.epoch_unix_ns = self.bus.now_unix_ns() + _LEAD_NS
        self.grant(Clock(0, 0, ClockState.EPOCH, {}, evidence.epoch_unix_ns))
        for tick in range(self.scenario.ticks + 1):
            self._until(evidence.epoch_unix_ns + tick * tick_ns)
            self.tick = tick
            self._begin(tick, tick * tick_ns)
            self._say_all(tick, tick * tick_ns)
        self._await_last_word()

    def _until(self, unix_ns: int) -> None:
        """Hear what comes by then."""
        try:
            while True:
                self.hear(unix_ns, "")
        except StalledError:
            return

    def _say_all(self, tick: int, now_ns: int) -> None:
        """What everybody has to say in a tick, each at its phase."""
        cues = [(cue.message, cue.label) for cue in script.realtime_cues(tick)]
        if tick % 2 == 0 and tick:
            cues += [(played.broadcast(now_ns), "") for played in self.played.values()]
        for message, label in sorted(cues, key=self._phase_ns):
            self._until(self.evidence.epoch_unix_ns + now_ns + self._phase_ns((message, label)))
            self.say(message, now_ns, label)

    def _phase_ns(self, cue: tuple[Message, str]) -> int:
        return phase_ns(cue[0].id, self.scenario.tick_ns)

    def _begin(self, tick: int, now_ns: int) -> None:
        """What the simulation and strangers have to say."""
        if tick == script.ANNOUNCED:
            plan = plan_json(self.evidence.plan)
            self.grant(Clock(tick, now_ns, ClockState.PLAN, {}, plan=plan))
        if tick == script.REPLAYED:
            said = self.evidence.labelled("repeated")[0]
            self.bus.put(topic_of(said.message), said.payload)
        if tick == script.FUTURE:
            ahead_ns = now_ns + script.FUTURE_NS
            self.say(self.played[1].broadcast(now_ns), ahead_ns, AHEAD, listed=False)
        if tick == script.STRANGERS:
            for topic, payload in garbage(self.played[1].broadcast(now_ns)):
                self.bus.put(topic, payload)

    def _await_last_word(self) -> None:
        last = self.scenario.ticks
        until_ns = self.bus.now_unix_ns() + min(LAST_WORDS_NS, self.patience_ns)
        if any(isinstance(h.message, Done) and h.message.tick == last for h in self.evidence.heard):
            return
        while True:
            message = self.hear(until_ns, f"it was not done after the last tick, {last}")
            if isinstance(message, Done) and message.id == FOREIGN and message.tick == last:
                return
