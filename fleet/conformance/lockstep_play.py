"""Plays the lockstep: grants tick after tick, with all that the script has."""

from __future__ import annotations

from collections import defaultdict

from fleet.conformance import script
from fleet.conformance.play import Play, StalledError
from fleet.conformance.scene import FOREIGN
from fleet.conformance.script import Cue, How
from fleet.faults.plan import plan_json
from fleet.model.words import ClockState
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import Clock, Done, Message
from fleet.protocol.topics import CLOCK

ListedPairs = tuple[tuple[int, int], ...]


class LockstepPlay(Play):
    """One tick is granted, and worked up, after the other."""

    def act(self) -> None:
        """All ticks of the scenario; raises StalledError."""
        self._listed: list[Message] = []
        self._late: list[Cue] = []
        self._early: list[Message] = []
        self.evidence.plan = script.fault_plan()
        for tick in range(self.scenario.ticks + 1):
            self._play(tick)

    def _play(self, tick: int) -> None:
        self.tick, now_ns = tick, tick * self.scenario.tick_ns
        if tick == script.FORGED:
            self._forge(tick)
        late = [(cue, self.numbered(cue.message, now_ns - script.TICK_NS)) for cue in self._late]
        listed, self._listed, self._late = [*self._listed, *(m for _, m in late)], [], []
        held = (FOREIGN,) if tick in script.HELD else ()
        plan = plan_json(self.evidence.plan) if tick == script.FAULTS_BEGIN else ""
        self.placed = tick >= script.FAULTS_BEGIN
        self.grant(Clock(tick, now_ns, ClockState.RUN, _manifest(listed), held=held, plan=plan))
        done = late and self._hasty()
        for cue, message in late:
            self.bring(message, cue.label)
        self._say_all(tick, now_ns)
        if held:
            self.settle()
        elif not done:
            self._await_done(tick)

    def _hasty(self) -> bool:
        """Whether it says to be done before all has come that the grant lists."""
        came = self.settle()
        for message in came:
            self._note(message)
        self.evidence.hasty = any(isinstance(message, Done) for message in came)
        return self.evidence.hasty

    def _note(self, message: Message | None) -> None:
        """What it says in a tick is listed in the next grant, if participants hear it."""
        if message is not None and message.id == FOREIGN and message.kind in AUDIBLE:
            self._listed.append(message)

    def _say_all(self, tick: int, now_ns: int) -> None:
        """What the played participants say in a tick, and what comes early of the next one."""
        self._listed += self._early
        self._early = [
            self.say(cue.message, now_ns + self.scenario.tick_ns, cue.label)
            for cue in script.cues(tick + 1)
            if cue.how is How.EARLY
        ]
        for played in self.played.values():
            played.fly_to(now_ns)
        for cue in script.cues(tick):
            if cue.how is How.LATE:
                self._late.append(cue)
            elif cue.how is not How.EARLY:
                said = self.say(cue.message, now_ns, cue.label, listed=cue.how is How.LISTED)
                self._listed += [said] if cue.how is How.LISTED else []
        for played in self.played.values() if tick % 2 == 0 and tick not in script.SILENT else ():
            self._listed.append(self.say(played.broadcast(now_ns), now_ns))
        if tick == script.STRANGE:
            for topic, payload in script.garbage(self.played[1].broadcast(now_ns)):
                self.bus.put(topic, payload)

    def _forge(self, tick: int) -> None:
        """Grant a tick that is not the next one."""
        far = tick + 50
        clock = Clock(far, far * self.scenario.tick_ns, ClockState.RUN, {})
        self.bus.put(CLOCK, codec.encode(clock))
        self.settle()

    def _await_done(self, tick: int) -> None:
        """Until it is done with the tick; what it sent in it is listed in the next grant."""
        until_ns = self.bus.now_unix_ns() + self.patience_ns
        while True:
            message = self.hear(until_ns, f"it was not done with tick {tick}")
            if isinstance(message, Done) and message.tick == tick:
                return
            if isinstance(message, Done):
                raise StalledError(f"it said to be done with tick {message.tick} in tick {tick}")
            self._note(message)


def _manifest(listed: list[Message]) -> dict[str, ListedPairs]:
    """The messages by suffix, as a grant lists them."""
    out: defaultdict[str, list[tuple[int, int]]] = defaultdict(list)
    for message in listed:
        out[message.suffix].append((message.id, message.seq))
    return {suffix: tuple(pairs) for suffix, pairs in sorted(out.items())}
