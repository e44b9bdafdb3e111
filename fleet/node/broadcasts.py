"""State broadcasts that come together, and how nodes take them in together.

What all UAVs send at one time reaches everybody at one time where no fault is at work. Where there
are many, it is taken in as columns: what is read from a broadcast is read once, and one pass over
a `TrackTable` serves all receivers that are in this process.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from fleet.model.conflict.track_table import ReportColumns, TrackRow, TrackTable
from fleet.model.conflict.tracks import TrafficPicture
from fleet.model.types import Integers, Position, Truths
from fleet.protocol.messages import Message, StateBroadcast

T = TypeVar("T", np.int64, np.float64, np.bool_)


class Reception(Struct, frozen=True, gc=False):
    """A message as the bus brought it; `place` is where its sender's radio was, if known."""

    topic: str
    payload: bytes
    message: Message
    arrived_ns: int = 0
    transit_ns: int = 0
    place: Position | None = None

    def order(self) -> tuple[int, int, str, int]:
        """Order of sending: time, source, class, sequence number."""
        m = self.message
        return (m.t_ns, m.id, m.kind, m.seq)


class Broadcasts:
    """What UAVs broadcast at one time, each once; not changed once any of it has been delivered."""

    def __init__(self, t_ns: int) -> None:
        self.t_ns = t_ns
        self.receptions: list[Reception] = []
        self.messages: list[StateBroadcast] = []
        self._issuers: set[int] = set()

    def add(self, reception: Reception, message: StateBroadcast) -> bool:
        """Take one of that time; False if it is of another, or there is one of that UAV already."""
        if message.t_ns != self.t_ns or message.id in self._issuers:
            return False
        self._issuers.add(message.id)
        self.receptions.append(reception)
        self.messages.append(message)
        return True

    @cached_property
    def issuers(self) -> Integers:
        """The UAVs, shape (n,)."""
        return np.array([m.id for m in self.messages], dtype=np.int64)

    @cached_property
    def mandated(self) -> Truths:
        """Which say that they are under a valid mandate, shape (n,)."""
        return np.array([m.mandate_valid for m in self.messages])

    @cached_property
    def mandate_terms(self) -> Integers:
        """The terms of their mandates, shape (n,)."""
        return np.array([m.mandate_term for m in self.messages], dtype=np.int64)

    @cached_property
    def highest_terms(self) -> Integers:
        """The highest terms that they have seen, shape (n,)."""
        return np.array([m.highest_term for m in self.messages], dtype=np.int64)

    @cached_property
    def bits(self) -> Integers:
        """How long they are, shape (n,)."""
        return np.array([8 * len(r.payload) for r in self.receptions], dtype=np.int64)

    @cached_property
    def reports(self) -> ReportColumns:
        """What they say, as far as it takes to judge them."""
        messages = self.messages
        items = np.empty(len(messages), dtype=object)
        items[:] = messages
        return ReportColumns(
            np.array([m.seq for m in messages], dtype=np.int64),
            np.array([m.applies_ns for m in messages], dtype=np.int64),
            np.array([(*m.position_ned_m, m.speed_mps) for m in messages]),
            items,
        )


@dataclass(frozen=True)
class Portion:
    """Of some broadcasts those that reach one receiver, by their places: all, if not told."""

    broadcasts: Broadcasts
    chosen: Sequence[int] | None = None

    def messages(self, number: int) -> Iterator[StateBroadcast]:
        """Those of others than a receiver of that number."""
        messages = self.broadcasts.messages
        heard = messages if self.chosen is None else [messages[n] for n in self.chosen]
        return (message for message in heard if message.id != number)

    def receptions(self, number: int) -> Iterator[Reception]:
        """The same as they came."""
        told = self.broadcasts.receptions
        heard = told if self.chosen is None else [told[n] for n in self.chosen]
        return (reception for reception in heard if reception.message.id != number)

    def places(self, number: int) -> Integers:
        """Where these are among the broadcasts, shape (n,)."""
        issuers = self.broadcasts.issuers
        if self.chosen is None:
            return np.flatnonzero(issuers != number)
        chosen = np.array(self.chosen, dtype=np.int64)
        others: Integers = chosen[issuers[chosen] != number]
        return others


class BroadcastArrivals:
    """A portion that reaches its receiver whole, at one moment."""

    def __init__(self, portion: Portion, receiver: int, at_ns: int) -> None:
        self.broadcasts = portion.broadcasts
        self._portion = portion
        self._receiver = receiver
        self._at_ns = at_ns

    @cached_property
    def places(self) -> Integers:
        """Which of the broadcasts it is, shape (n,)."""
        return self._portion.places(self._receiver)

    @cached_property
    def delivered_ns(self) -> Integers:
        """When each arrives, shape (n,)."""
        return np.full(len(self.places), self._at_ns, dtype=np.int64)

    def due(self, now_ns: int) -> tuple[BroadcastArrivals | None, BroadcastArrivals | None]:
        """Those that are due, and the rest; None if there are none such."""
        return (self, None) if self._at_ns <= now_ns else (None, self)

    def messages(self) -> Iterator[tuple[StateBroadcast, int]]:
        """Each, and when it is delivered."""
        return ((message, self._at_ns) for message in self._portion.messages(self._receiver))


class JudgedArrivals(BroadcastArrivals):
    """What faults have left of a portion, each at a time of its own."""

    def __init__(self, broadcasts: Broadcasts, places: Integers, delivered_ns: Integers) -> None:
        self.broadcasts = broadcasts
        self.places = places
        self.delivered_ns = delivered_ns

    def due(self, now_ns: int) -> tuple[BroadcastArrivals | None, BroadcastArrivals | None]:
        """Those that are due, and the rest; None if there are none such."""
        due = self.delivered_ns <= now_ns
        if due.all():
            return self, None
        return self._those(due), self._those(~due)

    def messages(self) -> Iterator[tuple[StateBroadcast, int]]:
        """Each, and when it is delivered."""
        places, delivered_ns = self.places.tolist(), self.delivered_ns.tolist()
        told = self.broadcasts.messages
        return ((told[n], at_ns) for n, at_ns in zip(places, delivered_ns, strict=True))

    def _those(self, chosen: Truths) -> JudgedArrivals | None:
        if not chosen.any():
            return None
        return JudgedArrivals(self.broadcasts, self.places[chosen], self.delivered_ns[chosen])


class Receiver(Protocol):
    """A node that keeps tracks."""

    @property
    def id(self) -> int:
        """Its number in messages."""
        ...

    @property
    def tracks(self) -> TrafficPicture:
        """What it knows of the others."""
        ...

    def hearing_ns(self, delivered_ns: int, now_ns: int) -> int:
        """What its clock shows when it hears something, in the step to `now_ns`."""
        ...

    def hearing_times_ns(self, delivered_ns: Integers, now_ns: int) -> Integers:
        """The same of several, shape (n,)."""
        ...

    def take_broadcast(self, message: StateBroadcast, sent: StateBroadcast, local_ns: int) -> None:
        """Take in one broadcast; `sent` is what it was before a fault altered it."""
        ...

    def answering(self, broadcasts: Broadcasts) -> Truths:
        """Which of them answer the elections that it goes by, shape (n,)."""
        ...

    def took_broadcasts(self, arrivals: BroadcastArrivals) -> None:
        """They have been taken in by its tracks."""
        ...

    def doubts(self, message: StateBroadcast) -> None:
        """Its tracks have found a broadcast implausible."""
        ...


def take_in(
    receivers: Sequence[Receiver], due: Sequence[Sequence[BroadcastArrivals]], now_ns: int
) -> None:
    """Let nodes take in, before they step, what is due to each."""
    rows = [r.tracks for r in receivers if isinstance(r.tracks, TrackRow)]
    if len(rows) < len(receivers):
        for receiver, its in zip(receivers, due, strict=True):
            for arrivals in its:
                for message, delivered_ns in arrivals.messages():
                    local_ns = receiver.hearing_ns(delivered_ns, now_ns)
                    receiver.take_broadcast(message, message, local_ns)
        return
    if any(due):
        _take_columns(receivers, rows, due, now_ns)
    for receiver, its in zip(receivers, due, strict=True):
        for arrivals in its:
            receiver.took_broadcasts(arrivals)


@dataclass(frozen=True)
class _Deliveries:
    """One row for each of n deliveries, whose broadcasts are those of `heard`."""

    heard: ReportColumns
    messages: list[StateBroadcast]
    receiver: Integers
    column: Integers
    of: Integers
    delivered_ns: Integers
    local_ns: Integers
    answering: Truths
    of_one_time: bool


def _take_columns(
    receivers: Sequence[Receiver],
    rows: Sequence[TrackRow],
    due: Sequence[Sequence[BroadcastArrivals]],
    now_ns: int,
) -> None:
    table = rows[0].table
    assert all(row.table is table for row in rows)
    all_of = _deliveries(receivers, due, table, now_ns)
    row = np.array([row.receiver for row in rows], dtype=np.int64)[all_of.receiver]
    for turn in _turns(row * len(table.uavs) + all_of.column, all_of):
        believed = table.take(
            row[turn],
            all_of.column[turn],
            all_of.of[turn],
            all_of.heard,
            local_ns=all_of.local_ns[turn],
            answering=all_of.answering[turn],
        )
        for n in np.flatnonzero(~believed).tolist():
            doubted = all_of.messages[int(all_of.of[turn][n])]
            receivers[int(all_of.receiver[turn][n])].doubts(doubted)


def _deliveries(
    receivers: Sequence[Receiver],
    due: Sequence[Sequence[BroadcastArrivals]],
    table: TrackTable,
    now_ns: int,
) -> _Deliveries:
    """What is due to all, one after another."""
    first: dict[int, int] = {}
    heard: list[Broadcasts] = []
    count = 0
    of, delivered, local, answering = [], [], [], []
    counts = [0] * len(due)
    for n, (receiver, its) in enumerate(zip(receivers, due, strict=True)):
        for arrivals in its:
            counts[n] += len(arrivals.places)
            broadcasts = arrivals.broadcasts
            if id(broadcasts) not in first:
                first[id(broadcasts)] = count
                heard.append(broadcasts)
                count += len(broadcasts.messages)
            of.append(arrivals.places + first[id(broadcasts)])
            delivered.append(arrivals.delivered_ns)
            local.append(receiver.hearing_times_ns(arrivals.delivered_ns, now_ns))
            answering.append(receiver.answering(broadcasts)[arrivals.places])
    places = _in_one(of)
    issuers = _in_one([b.issuers for b in heard])
    return _Deliveries(
        _joined([b.reports for b in heard]),
        [message for broadcasts in heard for message in broadcasts.messages],
        np.repeat(np.arange(len(due)), counts),
        np.searchsorted(table.uavs, issuers)[places],
        places,
        _in_one(delivered),
        _in_one(local),
        _in_one(answering),
        len(heard) == 1,
    )


def _in_one(parts: Sequence[NDArray[T]]) -> NDArray[T]:
    """One array of several; of one, as in a process that is one UAV, it itself."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _joined(parts: Sequence[ReportColumns]) -> ReportColumns:
    if len(parts) == 1:
        return parts[0]
    return ReportColumns(
        np.concatenate([p.seq for p in parts]),
        np.concatenate([p.t_ns for p in parts]),
        np.concatenate([p.state for p in parts]),
        np.concatenate([p.items for p in parts]),
    )


def _turns(cells: Integers, all_of: _Deliveries) -> Iterator[Integers | slice]:
    """Rows that may be taken in at once: of one UAV a receiver takes in one after another."""
    if all_of.of_one_time:
        yield slice(None)
        return
    order = np.lexsort((all_of.heard.seq[all_of.of], all_of.delivered_ns, cells))
    ordered = cells[order]
    begins = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    lengths = np.diff(np.concatenate([begins, [len(ordered)]]))
    turn = np.arange(len(ordered)) - np.repeat(begins, lengths)
    for n in range(int(lengths.max())):
        yield order[turn == n]
