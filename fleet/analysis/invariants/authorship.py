"""Authorship: every message in a log is one that its issuer says to have sent."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Found, Witness
from fleet.comms import codec
from fleet.comms.account import Account
from fleet.comms.gate import HARMLESS, REASONS
from fleet.comms.keys import DIGEST, OWN, REJECTED, issuer_of
from fleet.comms.messages import Done, Rejected, Truth
from fleet.log.reader import Record

_rejected = msgspec.msgpack.Decoder(Rejected)
_UNMANNED = ("held", "unmanned")


def authors(index: Index) -> Found:
    """Each issuer's messages are those that its own reports count, in number and content.

    Lockstep: tick by tick. Realtime: over the life of a process that was there to the end. And the
    range has refused nothing that was said in somebody's name.
    """
    found = Found()
    for record in index.history.records:
        if record.topic == REJECTED:
            _refused(found, record)
    for t_ns, came in _accounts(index):
        for name, (account, told) in came.items():
            found.examined += account.total()
            suffix = account.differs(told.sent if told else {}, told.digests if told else {})
            if suffix:
                topic = f"{name}/{suffix}"
                count = account.counts.get(suffix, 0)
                said = told.sent.get(suffix, 0) if told else 0
                what = f"{topic} is not what its issuer says to have sent"
                found.blame(what, Witness(t_ns, topic, {"logged": count, "told": said}))
    return found


def _refused(found: Found, record: Record) -> None:
    try:
        told = _rejected.decode(record.payload)
    except ValueError:
        return
    if told.why not in HARMLESS:
        meaning = REASONS.get(told.why, told.why)
        shown = {"on": told.topic, "why": told.why, "count": told.count}
        found.blame(f"a message on {told.topic}: {meaning}", Witness(told.t_ns, REJECTED, shown))


Came = dict[str, tuple[Account, Done | None]]


def _accounts(index: Index) -> Iterator[tuple[int, Came]]:
    """What came of each issuer and what it told: of each closed tick, in realtime of the run."""
    came: Came = {}
    realtime = index.history.realtime
    for record in index.history.records:
        if record.topic == DIGEST and not realtime:
            yield record.sent_ns, came
            came = {}
        elif record.topic not in OWN:
            _enter(came, record)
    if realtime:
        lasting = {
            n: one for n, one in came.items() if one[1] is not None and not _mortal(index, n)
        }
        yield index.end_ns, lasting


def _enter(came: Came, record: Record) -> None:
    name = issuer_of(record.topic)
    account, _ = came.setdefault(name, (Account(), None))
    kind = codec.kind_of(record.topic)
    try:
        if kind == Done.kind:
            done = codec.decode(record.topic, record.payload)
            came[name] = account, done if isinstance(done, Done) else None
            return
        if kind == Truth.kind:
            truth = codec.decode(record.topic, record.payload)
            if isinstance(truth, Truth) and truth.mode in _UNMANNED:
                return  # the range's, for an aircraft without a process
    except ValueError:
        pass  # it cannot be read, and counts as one of the issuer's
    account.add(record.topic, record.payload)


def _mortal(index: Index, name: str) -> bool:
    """Whether a process was killed at some time: then its last word is not about all."""
    number = int(name) if name.isdecimal() else 0
    return bool(index.downs.get(number))
