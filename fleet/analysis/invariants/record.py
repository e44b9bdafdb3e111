"""The record itself: the digest chain that the simulation wrote, computed again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import msgspec

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Examination, Witness
from fleet.log.reader import Record
from fleet.protocol.messages import Digest
from fleet.protocol.topics import DIGEST, SIMULATION_TOPICS

_digests = msgspec.msgpack.Decoder(Digest)


def record_intact(index: Index) -> Examination:
    """The chain of digests follows from the messages, tick by tick to the one stated at the end.

    Realtime runs have none: there only messages that cannot be read count.
    """
    examination = Examination()
    for record in index.garbled:
        examination.blame("a message is malformed, or cannot be of this run", _of(record))
    if index.run.realtime:
        examination.unknown = "realtime runs have no digest"
        return examination
    state, last = b"", ""
    for tick, (items, closing) in enumerate(_ticks(index)):
        examination.examined += 1
        state = _chained(state, items)
        try:
            closed = _digests.decode(closing.payload)
        except ValueError:
            examination.blame(f"the digest of tick {tick} is malformed", _of(closing))
            return examination
        last = closed.digest
        if closed.tick != tick:
            examination.blame(f"tick {tick} is missing", _of(closing, tick=closed.tick))
            return examination
        if last != state.hex():
            what = f"tick {tick} is the first that differs from its digest"
            examination.blame(what, _of(closing, tick=tick, digest=last, recomputed=state.hex()))
            return examination
    stated = index.run.digest
    if stated and stated != last:
        what = "the digest stated at the end is another"
        examination.blame(
            what, Witness(index.absences.end_ns, "result", {"digest": stated, "recomputed": last})
        )
    return examination


def _ticks(index: Index) -> Iterator[tuple[list[Record], Record]]:
    """The messages of each tick, and the digest that closes it."""
    items: list[Record] = []
    for record in index.run.records:
        if record.topic == DIGEST:
            yield items, record
            items = []
        elif record.topic not in SIMULATION_TOPICS:
            items.append(record)


def _chained(state: bytes, items: list[Record]) -> bytes:
    """The digest after one more tick, as the run recorder computes it."""
    chain = hashlib.blake2b(state, digest_size=16)
    for item in sorted(items, key=lambda i: (i.topic, i.seq)):
        chain.update(item.topic.encode())
        chain.update(item.payload)
    return chain.digest()


def _of(record: Record, **fields: object) -> Witness:
    return Witness(record.sent_ns, record.topic, fields)
