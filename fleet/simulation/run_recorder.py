"""The run recorder: what happened in each tick, in one order, as a digest, a tally and a record."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Protocol

from fleet.analysis.latency_bins import latency_bin
from fleet.analysis.run_summary import RunSummary
from fleet.config.scenario import Scenario
from fleet.model.conflict.risk import Required
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import Clock, Digest, Outage, Rejected, RoundTime
from fleet.protocol.topics import CLOCK, DIGEST, OUTAGE, REJECTED, ROUND_TIME, suffix_of
from fleet.transport.interface import ReceivedMessage


class RecordSink(Protocol):
    """Where records go: the MCAP recorder, or nowhere."""

    def write(self, topic: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Record one message."""
        ...


TOPIC_LENGTH = 200
REJECTED_APART = 100
"""So many topics and reasons are counted apart: anybody can think of more."""

Manifest = dict[str, tuple[tuple[int, int], ...]]
"""Messages by topic without issuer, each as its issuer and sequence number."""


class RunRecorder(RunSummary):
    """Takes every message of a run, records it, and keeps what is asked of it afterwards.

    The digest of tick k is BLAKE2b over the digest of k-1 and every topic and payload of k, ordered
    by topic and sequence number: the same for every bus, machine load and order of arrival.
    """

    def __init__(
        self, scenario: Scenario, sink: RecordSink | None, *others: Required, digested: bool = True
    ) -> None:
        """Where there is neither a sink nor a digest, what a run comes to is all that is kept.

        Then nobody needs payloads, nor the messages that are for the record alone.
        """
        super().__init__(scenario, *others)
        self._sink = sink
        self.keeps_record = digested or sink is not None
        if not self.keeps_record:
            self.tally.counts_receivers = False
        self._state = b""
        self.rejected: Counter[tuple[str, str]] = Counter()
        self._untold: Counter[tuple[str, str]] = Counter()
        self._rejections = 0
        self.rounds: Counter[int] = Counter()
        self.outages: list[Outage] = []
        self.watcher: Callable[[ReceivedMessage], None] | None = None
        """Is told every message, too."""

    @property
    def digest(self) -> str:
        """Digest of everything closed so far; empty if nobody asked for one."""
        return self._state.hex()

    def clock(self, clock: Clock, payload: bytes, said_ns: int | None = None) -> None:
        """Record a grant of the clock; in realtime `said_ns` is the moment when it was said."""
        log_ns = clock.t_ns if said_ns is None else said_ns
        if self._sink:
            self._sink.write(CLOCK, payload, max(clock.tick, 0), clock.t_ns, log_ns)

    def note(self, item: ReceivedMessage, log_ns: int) -> None:
        """Count, measure and record one message."""
        topic, payload, message = item
        self.add(message)
        if self.watcher:
            self.watcher(item)
        if self._sink:
            self._sink.write(topic, payload, message.seq, message.t_ns, log_ns)

    def refuse(self, topic: str, why: str) -> str:
        """Count what was not taken for a message of the run; returns its topic, fit to be shown."""
        shown = "".join(c if c.isprintable() else "?" for c in topic[:TOPIC_LENGTH])
        if (shown, why) not in self.rejected and len(self.rejected) >= REJECTED_APART:
            shown = "others"
        self.rejected[shown, why] += 1
        self._untold[shown, why] += 1
        return shown

    def tell_refused(self, t_ns: int) -> None:
        """Record what has been refused since this was last done."""
        for (topic, why), count in sorted(self._untold.items()):
            if self._sink:
                payload = codec.encode(Rejected(t_ns, topic, why, count))
                self._sink.write(REJECTED, payload, self._rejections, t_ns, t_ns)
            self._rejections += 1
        self._untold.clear()

    def tell_round(self, t_ns: int, uav: int, took_ns: int) -> None:
        """Record how long a round of the resolver took: measured, and in no digest."""
        if self._sink:
            payload = codec.encode(RoundTime(t_ns, uav, took_ns))
            self._sink.write(ROUND_TIME, payload, self.rounds.total(), t_ns, t_ns)
        self.rounds[latency_bin(took_ns)] += 1

    def tell_outage(self, outage: Outage) -> None:
        """Record that a participant was not heard for a while."""
        if self._sink:
            number, t_ns = len(self.outages), outage.t_ns
            self._sink.write(OUTAGE, codec.encode(outage), number, t_ns, t_ns)
        self.outages.append(outage)

    def close(self, tick: int, t_ns: int, items: Sequence[ReceivedMessage]) -> None:
        """Close a lockstep tick: all its messages, in any order."""
        ordered = sorted(items, key=lambda i: (i[0], i[2].seq))
        for item in ordered:
            self.note(item, t_ns)
        self.settle(t_ns)
        if self.keeps_record:
            self._state = _digest(self._state, ordered)
        if self._untold:
            self.tell_refused(t_ns)
        if self._sink:
            closed = Digest(tick, t_ns, self.digest)
            self._sink.write(DIGEST, codec.encode(closed), tick, t_ns, t_ns)


def _digest(before: bytes, items: Sequence[ReceivedMessage]) -> bytes:
    state = hashlib.blake2b(before, digest_size=16)
    for topic, payload, _ in items:
        state.update(topic.encode())
        state.update(payload)
    return state.digest()


def manifest(items: Sequence[ReceivedMessage]) -> Manifest:
    """The manifest of a tick: messages for other participants, listed by topic without issuer."""
    listed: dict[str, list[tuple[int, int]]] = {}
    for topic, _, message in items:
        if message.kind in AUDIBLE:
            listed.setdefault(suffix_of(topic), []).append((message.id, message.seq))
    return {suffix: tuple(sorted(listed[suffix])) for suffix in sorted(listed)}
