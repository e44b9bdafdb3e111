"""The subscriptions of a lockstep participant, which go with it from cell to cell.

What is subscribed to in a step takes effect before the simulation hears that the step is done: the
router takes the two in this order. So it is there for all that is sent in the next tick, and waited
for from the manifest that lists that on. What is no longer within reach is left once the manifest
of the tick has been served in which it still was. Where nothing is listed, there is nothing to be
waited for: what comes all the same is looked at now and then, so that it does not pile up.
"""

from __future__ import annotations

from collections.abc import Sequence

from fleet.node.gate import Gate
from fleet.node.intake import Intake, Listed, Taken
from fleet.protocol.messages import Clock
from fleet.protocol.topics import ANY, is_broadcast
from fleet.transport.zenoh_bus import Bus

SWEPT_TICKS = 16
"""In one of so many ticks all topics are looked at, of which nothing is listed too."""


class Subscriptions:
    """`intakes` has what is subscribed to, by suffix."""

    def __init__(self, bus: Bus, number: int, gate: Gate) -> None:
        self._bus, self._number, self._gate = bus, number, gate
        self._wanted: Sequence[str] = ()
        self._new: frozenset[str] = frozenset()
        self.intakes: dict[str, Intake] = {}
        self._lacked_room = 0

    @property
    def lacked_room(self) -> int:
        """How many messages there was no room for, also of what has been left."""
        count = self._lacked_room
        for intake in self.intakes.values():
            count += intake.lacked_room
        return count

    def want(self, suffixes: Sequence[str]) -> None:
        """Subscribe to these from the next tick on, and to what else there is until then."""
        self._new = frozenset()
        if suffixes is self._wanted:
            return
        self._wanted = suffixes
        self._new = frozenset(suffixes) - self.intakes.keys()
        for suffix in suffixes:
            if suffix in self._new:
                self._bus.listen(f"*/{suffix}", own=not is_broadcast(suffix))
        left = [suffix for suffix in self.intakes if suffix not in suffixes]
        # not changed but replaced: another thread tells what is in it
        self.intakes = {s: self.intakes.get(s) or Intake(self._gate) for s in (*suffixes, *left)}

    def take(self, clock: Clock | None) -> list[Taken]:
        """Wait for all that is for this participant of what a grant lists; of none nothing."""
        taken: list[Taken] = []
        sweeping = clock is None or clock.tick % SWEPT_TICKS == 0
        for suffix, intake in self.intakes.items():
            listed: Sequence[Listed] = ()
            if clock is not None and suffix not in self._new:
                listed = listed_for(self._number, clock, suffix)
            if sweeping:
                self._sweep(f"*/{suffix}", intake)
            if listed:
                taken += self._taken(f"*/{suffix}", intake, listed)
        self._new = frozenset()
        self._leave()
        return taken

    def _sweep(self, topic: str, intake: Intake) -> None:
        """Let all wait in the intake that has come on a topic."""
        for arrival in self._bus.waiting(topic):
            intake.offer(arrival)

    def _taken(self, topic: str, intake: Intake, listed: Sequence[Listed]) -> list[Taken]:
        """Take what is listed of a topic."""
        return intake.take(listed, lambda: self._bus.take(topic))

    def _leave(self) -> None:
        """End what is no longer wanted."""
        left = self.intakes.keys() - self._wanted
        for suffix in left:
            self._bus.leave(f"*/{suffix}")
        if left:
            for suffix in left:
                self._lacked_room += self.intakes[suffix].lacked_room
            self.intakes = {s: i for s, i in self.intakes.items() if s not in left}


def listed_for(number: int, clock: Clock, suffix: str) -> Sequence[Listed]:
    """What the manifest lists of a topic for a participant: a broadcast does not come back."""
    kind, _, end = suffix.partition("/")
    if end != ANY and suffix not in clock.expected:
        return ()
    if end == ANY:
        every = (one for topic, one in clock.expected.items() if topic.startswith(f"{kind}/"))
        listed: Sequence[Listed] = [message for messages in every for message in messages]
    else:
        listed = clock.expected.get(suffix, ())
    return [one for one in listed if one[0] != number] if is_broadcast(suffix) else listed
