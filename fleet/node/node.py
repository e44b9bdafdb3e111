"""A node: what a participant is to those who run it, whatever it does."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Annotated, Protocol

from msgspec import Meta, Struct

from fleet.faults.rules import Rule
from fleet.model.types import Position
from fleet.node.broadcasts import Receiver
from fleet.protocol.bounds import TimeNs
from fleet.protocol.classes import DELIVERY_ORDER
from fleet.protocol.messages import Message, PersistentState, Truth

_RANK = {kind: n for n, kind in enumerate(DELIVERY_ORDER)}
MOST_INCARNATIONS = 10**6
"""So often a process may be started again: each incarnation has numbers of its own."""


class RestartState(Struct, frozen=True, gc=False):
    """What a process that is started again finds: how often it has been, its memory, its state."""

    incarnation: Annotated[int, Meta(ge=0, le=MOST_INCARNATIONS)]
    t_ns: TimeNs
    memory: PersistentState | None = None
    truth: Truth | None = None


def delivery_order(delivered_ns: int, src: int, kind: str, seq: int) -> tuple[int, int, int, int]:
    """By what messages are ordered that come to one node: time, source, class, sequence number."""
    return delivered_ns, src, _RANK.get(kind, len(_RANK)), seq


class InboxMessage(Struct, frozen=True, gc=False):
    """A message and the moment at which it is delivered.

    `sent` is the message as it was sent, where a fault has altered what is delivered. Measured in
    realtime alone: `transit_ns`, what zenoh took; `delay_ns`, what faults were to add; `slip_ns`,
    how much later than that it was delivered.
    """

    delivered_ns: int
    message: Message
    sent: Message | None = None
    transit_ns: int = 0
    delay_ns: int = 0
    slip_ns: int = 0

    @property
    def original(self) -> Message:
        """The message as it was sent."""
        return self.sent or self.message

    def order(self) -> tuple[int, int, int, int]:
        """As `delivery_order`."""
        m = self.original
        return delivery_order(self.delivered_ns, m.id, m.kind, m.seq)


class Node(Receiver, Protocol):
    """A participant: a UAV or the coordinator."""

    stopwatch: Callable[[], int]
    """The time in ns by which it measures how long it computes; in memory it stands still."""

    round_ns: int
    """How long the round of the resolver took that it ran in its last step; 0 if none."""

    @property
    def doing(self) -> str:
        """What it is about in a step, in words, should that not end."""
        ...

    @property
    def takes_together(self) -> bool:
        """Whether broadcasts that come together may be taken in before it steps."""
        ...

    @property
    def hears(self) -> tuple[str, ...]:
        """Topic suffixes that it receives, from any issuer."""
        ...

    @property
    def position_ned_m(self) -> Position:
        """Where its radio is."""
        ...

    @property
    def implausible(self) -> Collection[tuple[int, int]]:
        """Broadcasts (source, seq) that it found implausible in its last step, or before it."""
        ...

    def step(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[Message]:
        """Advance to `now_ns`, taking in what was delivered since, and return what to send.

        Of the broadcasts, some may have been taken in already (`fleet.node.broadcasts.take_in`).
        """
        ...

    def replan(self, plan: Sequence[Rule]) -> None:
        """Suffer from another fault plan from now on."""
        ...
