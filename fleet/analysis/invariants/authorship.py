"""Authorship: every message in a log is one that its issuer says to have sent, or can have sent."""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field

import msgspec

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Found, Witness
from fleet.comms import codec
from fleet.comms.account import Account
from fleet.comms.attendance import Attendance
from fleet.comms.gate import HARMLESS, REASONS
from fleet.comms.keys import CLOCK, DIGEST, OWN, REJECTED, issuer_of
from fleet.comms.messages import UNMANNED, Done, Rejected, Truth
from fleet.log.reader import Record


class _Heading(msgspec.Struct):
    """What every message of a participant begins with."""

    id: int
    seq: int
    t_ns: int


_rejected = msgspec.msgpack.Decoder(Rejected)
_heading = msgspec.msgpack.Decoder(_Heading)


def authors(index: Index) -> Found:
    """Each issuer's messages are those that its own reports count, in number and content.

    Lockstep: tick by tick. Realtime: over the life of a process that was there to its end; and all
    that comes in its name is what it can have sent, dead or alive. And the range has refused
    nothing that was said in somebody's name.
    """
    found = Found()
    for record in index.history.records:
        if record.topic == REJECTED:
            _refused(found, record)
    if index.history.realtime:
        _lives(index, found)
    else:
        _ticks(index, found)
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


@dataclass
class _Told:
    """What came of an issuer, in a tick or a life, and what it told of that itself."""

    account: Account = field(default_factory=Account)
    done: Done | None = None

    def enter(self, record: Record) -> None:
        """Take in a record; one that cannot be read counts as one of the issuer's."""
        done = None
        if codec.kind_of(record.topic) == Done.kind:
            with suppress(ValueError):
                done = codec.decode(record.topic, record.payload)
        if isinstance(done, Done):
            self.done = done
        else:
            self.account.add(record.topic, record.payload)

    def compare(self, found: Found, name: str, t_ns: int) -> None:
        """Note where the two differ."""
        sent, digests = (self.done.sent, self.done.digests) if self.done else ({}, {})
        suffix = self.account.differs(sent, digests)
        if suffix:
            topic = f"{name}/{suffix}"
            what = f"{topic} is not what its issuer says to have sent"
            shown = {"logged": self.account.counts.get(suffix, 0), "told": sent.get(suffix, 0)}
            found.blame(what, Witness(t_ns, topic, shown))


def _ticks(index: Index, found: Found) -> None:
    """Lockstep: each closed tick by itself."""
    came: defaultdict[str, _Told] = defaultdict(_Told)
    for record in index.history.records:
        if record.topic == DIGEST:
            for name, told in came.items():
                found.examined += told.account.total()
                told.compare(found, name, record.sent_ns)
            came.clear()
        elif record.topic not in OWN and not _by_range(record):
            came[issuer_of(record.topic)].enter(record)


def _lives(index: Index, found: Found) -> None:
    """Realtime: each message by itself, and the lives of those that have told what they sent."""
    attendance = Attendance(index.tick_ns)
    lives: defaultdict[tuple[str, int], _Told] = defaultdict(_Told)
    for record in index.history.records:
        if record.topic == CLOCK:
            clock = index.roster.clock(record)
            if clock is not None:
                attendance.hear(clock, record.log_ns)
        elif record.topic not in OWN and not _by_range(record):
            life = _possible(index, found, attendance, record)
            lives[issuer_of(record.topic), life].enter(record)
    for (name, _), told in lives.items():
        found.examined += told.account.total()
        if told.done is not None:
            told.compare(found, name, index.end_ns)


def _possible(index: Index, found: Found, attendance: Attendance, record: Record) -> int:
    """The life of its issuer in which a message was sent; if it cannot have been, that is noted."""
    address = index.roster.address(record)
    try:
        heading = _heading.decode(record.payload)
    except ValueError:
        heading = None
    if address is None or heading is None or heading.id != address.issuer:
        return 0  # no message of this run; that is reported elsewhere
    of = heading.id, codec.kind_of(record.topic), heading.seq, heading.t_ns
    life, why = attendance.life_of(*of), attendance.refusal(*of, record.log_ns)
    if why:
        shown = {"seq": heading.seq, "logged_s": record.log_ns / 1e9, "why": why}
        what = f"a message on {record.topic}: {REASONS[why]}"
        found.blame(what, Witness(heading.t_ns, record.topic, shown))
    return life


def _by_range(record: Record) -> bool:
    """Whether it is a true state that the range told, of an aircraft without a process."""
    if codec.kind_of(record.topic) != Truth.kind:
        return False
    try:
        truth = codec.decode(record.topic, record.payload)
    except ValueError:
        return False
    return isinstance(truth, Truth) and truth.mode in UNMANNED
