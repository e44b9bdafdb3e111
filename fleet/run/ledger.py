"""The ledger: what happened in each tick, in one order, as a digest, a tally and a record."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Protocol

from fleet.analysis.moments import Moments
from fleet.analysis.separation import SeparationMonitor
from fleet.analysis.tally import Tally
from fleet.comms import codec
from fleet.comms.keys import CLOCK, DIGEST, suffix_of
from fleet.comms.messages import HEARD, Clock, Digest, Message, Truth
from fleet.model.generate import uavs_of
from fleet.model.scenario import Scenario
from fleet.model.trajectory import Array


class Sink(Protocol):
    """Where records go: the MCAP recorder, or nowhere."""

    def write(self, topic: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Record one message."""
        ...


Item = tuple[str, bytes, Message]
"""Topic, payload and decoded message."""


class Ledger:
    """Takes every message of a run and keeps what is asked of it afterwards.

    The digest of tick k is BLAKE2b over the digest of k-1 and every topic and payload of k, ordered
    by topic and sequence number: the same for every bus, machine load and order of arrival.
    """

    def __init__(self, scenario: Scenario, sink: Sink | None) -> None:
        self._ids = [u.id for u in uavs_of(scenario)]
        self._sink = sink
        self._state = b""
        self._moments = Moments(self._ids)
        self.vanished: frozenset[int] = frozenset()
        self.separation = SeparationMonitor(self._ids, scenario.required())
        self.tally = Tally(len(self._ids), scenario.coordination.electors == "coordinator")
        self.messages: Counter[str] = Counter()

    @property
    def digest(self) -> str:
        """Digest of everything closed so far."""
        return self._state.hex()

    def clock(self, clock: Clock, payload: bytes) -> None:
        """Record a grant of the clock."""
        if self._sink:
            self._sink.write(CLOCK, payload, max(clock.tick, 0), clock.t_ns, clock.t_ns)

    def note(self, item: Item, log_ns: int) -> None:
        """Count, measure and record one message."""
        topic, payload, message = item
        self.messages[message.kind] += 1
        if isinstance(message, Truth):
            self._moments.add(message.id, message.t_ns, message.position_ned_m)
            if self.messages[Truth.kind] % max(1, len(self._ids)) == 0:
                self._measure(self._moments.upto(self._moments.settled_ns(self.vanished)))
        else:
            self.tally.add(message)
        if self._sink:
            self._sink.write(topic, payload, message.seq, message.t_ns, log_ns)

    def close(self, tick: int, t_ns: int, items: Sequence[Item]) -> None:
        """Close a lockstep tick: all its messages, in any order."""
        state = hashlib.blake2b(self._state, digest_size=16)
        for item in sorted(items, key=lambda i: (i[0], i[2].seq)):
            state.update(item[0].encode())
            state.update(item[1])
            self.note(item, t_ns)
        self._measure(self._moments.upto(t_ns))
        self._state = state.digest()
        if self._sink:
            closed = Digest(tick, t_ns, self.digest)
            self._sink.write(DIGEST, codec.encode(closed), tick, t_ns, t_ns)

    def finish(self) -> None:
        """The run is over: measure what was waited for (nothing, in lockstep)."""
        self._measure(self._moments.rest())

    def _measure(self, moments: Iterable[tuple[int, Array]]) -> None:
        for t_ns, positions in moments:
            self.separation.update(t_ns, positions)


def expected_counts(items: Sequence[Item]) -> dict[str, int]:
    """The manifest of a tick: messages for other participants, counted by topic without issuer."""
    counts = Counter(suffix_of(topic) for topic, _, message in items if message.kind in HEARD)
    return dict(sorted(counts.items()))
