"""Authorship: every message in a log is one that its issuer says to have sent, or can have sent."""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field

import msgspec

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Examination, Witness
from fleet.log.reader import Record
from fleet.model.words import UNMANNED
from fleet.node.gate import HARMLESS, REFUSAL_TEXTS
from fleet.protocol import codec
from fleet.protocol.account import Account
from fleet.protocol.attendance import Attendance
from fleet.protocol.messages import Done, Outage, Rejected, Truth
from fleet.protocol.topics import (
    CLOCK,
    DIGEST,
    OUTAGE,
    REJECTED,
    SIMULATION_TOPICS,
    issuer_number,
    issuer_of,
    topic_of,
)


class _Heading(msgspec.Struct):
    """What every message of a participant begins with."""

    id: int
    seq: int
    t_ns: int


_outages = msgspec.msgpack.Decoder(Outage)
_rejected = msgspec.msgpack.Decoder(Rejected)
_heading = msgspec.msgpack.Decoder(_Heading)


def authors(index: Index) -> Examination:
    """Each issuer's messages are those that its own reports count, in number and content.

    Lockstep: tick by tick. Realtime: over the incarnation of a process that was there to its end;
    and all that comes in its name is what it can have sent, dead or alive. And the simulation has
    refused nothing that was said in somebody's name. With cells a broadcast is to that in which its
    issuer was.
    """
    examination = Examination()
    for record in index.run.records:
        if record.topic == REJECTED:
            _refused(examination, record)
    _in_their_cells(index, examination)
    if index.run.realtime:
        _incarnations(index, examination)
    else:
        _ticks(index, examination)
    return examination


def _in_their_cells(index: Index, examination: Examination) -> None:
    """With cells: a UAV broadcasts to the one in which it is."""
    cells = index.scenario.cells()
    if cells is None:
        return
    for sent in index.sent.values():
        m = sent.message
        place = index.places.get((m.id, m.t_ns))
        if place is not None and topic_of(m, cells.name(place)) != sent.topic:
            what = f"a message on {sent.topic}: its issuer was in cell {cells.name(place)}"
            examination.blame(what, Witness(m.t_ns, sent.topic, {"seq": m.seq}))


def _refused(examination: Examination, record: Record) -> None:
    try:
        told = _rejected.decode(record.payload)
    except ValueError:
        return
    if told.why not in HARMLESS:
        meaning = REFUSAL_TEXTS.get(told.why, told.why)
        shown = {"on": told.topic, "why": told.why, "count": told.count}
        examination.blame(
            f"a message on {told.topic}: {meaning}", Witness(told.t_ns, REJECTED, shown)
        )


@dataclass
class _Claims:
    """What came of an issuer, in a tick or an incarnation, and what it told of that itself."""

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

    def compare(self, examination: Examination, name: str, t_ns: int) -> None:
        """Note where the two differ."""
        sent, digests = (self.done.sent, self.done.digests) if self.done else ({}, {})
        suffix = self.account.differs(sent, digests)
        if suffix:
            topic = f"{name}/{suffix}"
            what = f"{topic} is not what its issuer says to have sent"
            shown = {"logged": self.account.counts.get(suffix, 0), "told": sent.get(suffix, 0)}
            examination.blame(what, Witness(t_ns, topic, shown))


def _ticks(index: Index, examination: Examination) -> None:
    """Lockstep: each closed tick by itself."""
    came: defaultdict[str, _Claims] = defaultdict(_Claims)
    for record in index.run.records:
        if record.topic == DIGEST:
            for name, told in came.items():
                examination.examined += told.account.total()
                told.compare(examination, name, record.sent_ns)
            came.clear()
        elif record.topic not in SIMULATION_TOPICS and not _by_range(record):
            came[issuer_of(record.topic)].enter(record)


def _incarnations(index: Index, examination: Examination) -> None:
    """Realtime: each message by itself, and the incarnations that have told what they sent."""
    attendance = Attendance(index.tick_ns)
    incarnations: defaultdict[tuple[str, int], _Claims] = defaultdict(_Claims)
    for record in index.run.records:
        if record.topic == CLOCK:
            clock = index.participant_filter.clock(record)
            if clock is not None:
                attendance.hear(clock, record.log_ns)
        elif record.topic == OUTAGE:
            with suppress(ValueError):
                attendance.outage(_outages.decode(record.payload))
        elif record.topic not in SIMULATION_TOPICS and not _by_range(record):
            incarnation = _possible(index, examination, attendance, record)
            incarnations[issuer_of(record.topic), incarnation].enter(record)
    for (name, number), told in incarnations.items():
        examination.examined += told.account.total()
        cut = attendance.was_cut(issuer_number(name), number)
        if told.done is not None and not (cut and not told.account.exceeds(told.done.sent)):
            told.compare(examination, name, index.absences.end_ns)
    index.missing = attendance.missing


def _possible(
    index: Index, examination: Examination, attendance: Attendance, record: Record
) -> int:
    """In which incarnation of its issuer a message was sent; if in none, that is noted."""
    address = index.participant_filter.address(record)
    try:
        heading = _heading.decode(record.payload)
    except ValueError:
        heading = None
    if address is None or heading is None or heading.id != address.issuer:
        return 0  # no message of this run; that is reported elsewhere
    of = heading.id, codec.kind_of(record.topic), heading.seq, heading.t_ns
    incarnation, why = attendance.incarnation_of(*of), attendance.refusal(*of, record.log_ns)
    if why:
        shown = {"seq": heading.seq, "logged_s": record.log_ns / 1e9, "why": why}
        what = f"a message on {record.topic}: {REFUSAL_TEXTS[why]}"
        examination.blame(what, Witness(heading.t_ns, record.topic, shown))
    return incarnation


def _by_range(record: Record) -> bool:
    """Whether it is a true state that the simulation told, of an aircraft without a process."""
    if codec.kind_of(record.topic) != Truth.kind:
        return False
    try:
        truth = codec.decode(record.topic, record.payload)
    except ValueError:
        return False
    return isinstance(truth, Truth) and truth.mode in UNMANNED
