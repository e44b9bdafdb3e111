"""State broadcasts that come together, and how nodes take them in together.

What all UAVs send at one time reaches everybody at one time where no fault is at work. Where there
are many, it is taken in as columns: what is read from a broadcast is read once, and one pass over
a `TrackTable` serves all receivers that are in this process.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import chain
from typing import Protocol

import numpy as np
from msgspec import Struct

from fleet.model.conflict.track_table import (
    Integers,
    ReportColumns,
    TrackRow,
    Truths,
)
from fleet.model.conflict.tracks import TrafficPicture
from fleet.model.types import Position
from fleet.protocol.messages import Message, StateBroadcast


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
    def highest_term(self) -> int:
        """Of all that they have seen."""
        return max((m.highest_term for m in self.messages), default=0)

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


class Portion:
    """Of some broadcasts those that one receiver hears, by their places: all, if not told."""

    def __init__(self, broadcasts: Broadcasts, places: Sequence[int] | None = None) -> None:
        self.broadcasts = broadcasts
        self.places = places

    def receptions(self, number: int) -> Iterator[tuple[Reception, StateBroadcast]]:
        """Those of others than a receiver of that number."""
        all_of = self.broadcasts
        for place in range(len(all_of.messages)) if self.places is None else self.places:
            if all_of.messages[place].id != number:
                yield all_of.receptions[place], all_of.messages[place]


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

    def take_broadcast(self, message: StateBroadcast, sent: StateBroadcast, local_ns: int) -> None:
        """Take in one broadcast; `sent` is what it was before a fault altered it."""
        ...

    def answering(self, broadcasts: Broadcasts) -> Truths:
        """Which of them answer the elections that it goes by."""
        ...

    def took_broadcasts(self, broadcasts: Broadcasts, implausible: Sequence[int]) -> None:
        """They have been taken in by its tracks, but for the implausible ones, by their place."""
        ...


def take_in(
    receivers: Sequence[Receiver], portions: Sequence[Portion], delivered_ns: int, now_ns: int
) -> None:
    """Let nodes take in what they hear of some broadcasts, each its portion, but for its own."""
    local_ns = [r.hearing_ns(delivered_ns, now_ns) for r in receivers]
    rows = [r.tracks for r in receivers if isinstance(r.tracks, TrackRow)]
    if len(rows) == len(receivers):
        _take_columns(receivers, rows, portions, np.array(local_ns, dtype=np.int64))
        return
    for receiver, portion, at_ns in zip(receivers, portions, local_ns, strict=True):
        for _, message in portion.receptions(receiver.id):
            receiver.take_broadcast(message, message, at_ns)


def _take_columns(
    receivers: Sequence[Receiver],
    rows: Sequence[TrackRow],
    portions: Sequence[Portion],
    local_ns: Integers,
) -> None:
    table, broadcasts = rows[0].table, portions[0].broadcasts
    assert all(row.table is table for row in rows)
    receiver, of = _deliveries(receivers, portions)
    answering = np.zeros(len(of), dtype=np.bool_)
    if broadcasts.mandated.any():
        answering = np.array([r.answering(broadcasts) for r in receivers])[receiver, of]
    believed = table.take(
        np.array([row.receiver for row in rows], dtype=np.int64)[receiver],
        np.searchsorted(table.uavs, broadcasts.issuers)[of],
        of,
        broadcasts.reports,
        local_ns[receiver],
        answering,
    )
    implausible: dict[int, list[int]] = {}
    for n in np.nonzero(~believed)[0].tolist():
        implausible.setdefault(int(receiver[n]), []).append(int(of[n]))
    for n, node in enumerate(receivers):
        node.took_broadcasts(broadcasts, implausible.get(n, ()))


def _deliveries(
    receivers: Sequence[Receiver], portions: Sequence[Portion]
) -> tuple[Integers, Integers]:
    """For each of n deliveries the places of its receiver and of its broadcast, each shape (n,)."""
    issuers = portions[0].broadcasts.issuers
    own = np.array([r.id for r in receivers], dtype=np.int64)
    if all(p.places is None for p in portions):
        receiver, of = np.nonzero(own[:, None] != issuers[None, :])
        return receiver, of
    every = range(len(issuers))
    places = [every if p.places is None else p.places for p in portions]
    receiver = np.repeat(np.arange(len(places)), [len(some) for some in places])
    of = np.fromiter(chain.from_iterable(places), dtype=np.int64, count=len(receiver))
    others = own[receiver] != issuers[of]
    return receiver[others], of[others]
