"""With a radio range: how many were within it of each message, counted while the run is on."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection

from fleet.analysis.earshots import EarTracker
from fleet.config.scenario import Scenario
from fleet.model.radio import Earshot
from fleet.protocol.messages import AddressedMessage, Message, Truth


class RangeCount:
    """Holds messages and true states of each tick until nothing more comes of it."""

    def __init__(self, scenario: Scenario) -> None:
        self._radio, self._tick_ns = scenario.radio(), scenario.tick_ns
        self._tracker = EarTracker(scenario)
        self._waiting: defaultdict[int, list[Message]] = defaultdict(list)
        self._states: defaultdict[int, list[Truth]] = defaultdict(list)

    def wait(self, message: Message) -> None:
        """Take a message, or a true state, of any tick that is not over."""
        t_ns = -(-message.t_ns // self._tick_ns) * self._tick_ns
        if isinstance(message, Truth):
            self._states[t_ns].append(message)
        else:
            self._waiting[t_ns].append(message)

    def count(self, t_ns: int, deaf: Collection[int]) -> Counter[str]:
        """Receivers of the messages up to a time, by class, without those who are deaf."""
        out: Counter[str] = Counter()
        times = {t for known in (self._states, self._waiting) for t in known if t <= t_ns}
        for now_ns in sorted(times):
            earshot = Earshot(self._radio, *self._tracker.step(self._states.pop(now_ns, ())))
            for message in self._waiting.pop(now_ns, ()):
                out[message.kind] += sum(n not in deaf for n in _hearers(earshot, message))
        return out


def _hearers(earshot: Earshot, message: Message) -> list[int]:
    """Whom a message is for, of those within range."""
    if isinstance(message, AddressedMessage):
        return [message.target] if earshot.hears(message.id, message.target) else []
    return [n for n in earshot.hearers(message.id) if message.is_for(n)]
