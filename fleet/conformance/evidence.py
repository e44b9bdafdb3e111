"""What a play has said and heard: all that the rules judge by."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeVar

from fleet.config.scenario import Scenario
from fleet.faults.rules import Rule
from fleet.model.types import Position
from fleet.model.words import ClockMode
from fleet.protocol import codec
from fleet.protocol.messages import (
    Ack,
    Clock,
    Command,
    DeliveryReport,
    Done,
    Message,
    StateBroadcast,
    Truth,
)
from fleet.protocol.sample import Sample

M = TypeVar("M", bound=Message)

MessageName = tuple[str, int, int]
"""Class, source and number of a message."""
MessageFates = dict[MessageName, list[tuple[int, int, str]]]
"""Of each message: the step in which it is reported, when it was delivered (ns), its fate."""


@dataclass(frozen=True)
class HeardMessage:
    """What came of the foreign UAV: in which tick, as what; `flaw` says why it is no message."""

    tick: int
    sample: Sample
    message: Message | None = None
    flaw: str = ""


@dataclass(frozen=True)
class SaidMessage:
    """What was played to it; `listed` where a manifest lists it, so that it is to be used.

    `label` is what the script calls it, `sent_unix_ns` when it was sent, in realtime.
    """

    message: Message
    payload: bytes
    listed: bool = True
    label: str = ""
    place: Position | None = None
    sent_unix_ns: int = 0


@dataclass(eq=False)
class Evidence:
    """All that was said and heard in one play, in order; ticks are those of the clock.

    `stalled` says what the UAV did not do, so that the play ended early; empty if it did not.
    """

    scenario: Scenario
    number: int
    clock: ClockMode
    heard: list[HeardMessage] = field(default_factory=list)
    said: list[SaidMessage] = field(default_factory=list)
    grants: list[Clock] = field(default_factory=list)
    plan: tuple[Rule, ...] = ()
    alive_when_ready: bool = False
    hasty: bool | None = None
    left: bool | None = None
    epoch_unix_ns: int = 0
    stalled: str = ""

    @property
    def last_tick(self) -> int:
        """The last tick that the UAV was granted and worked up; -1: none."""
        held = {grant.tick for grant in self.grants if self.number in grant.held}
        done = {m.tick for m in self.of(Done)} | held
        return max((grant.tick for grant in self.grants if grant.tick in done), default=-1)

    def hear(self, tick: int, sample: Sample) -> Message | None:
        """Enter what came of the UAV; the message, if it is one."""
        try:
            message = None if sample.flaw else codec.decode(sample.topic, sample.payload)
        except ValueError as error:
            self.heard.append(HeardMessage(tick, sample, None, str(error)))
            return None
        self.heard.append(HeardMessage(tick, sample, message, sample.flaw))
        return message

    def of(self, cls: type[M]) -> Iterator[M]:
        """Its messages of a class."""
        return (h.message for h in self.heard if isinstance(h.message, cls))

    def labelled(self, label: str) -> list[SaidMessage]:
        """What the script calls so, if it was said."""
        return [said for said in self.said if said.label == label]

    def acks(self, command: Command) -> list[Ack]:
        """Its answers to a command."""
        named = command.term, command.number, command.id
        return [a for a in self.of(Ack) if (a.term, a.number, a.target) == named]

    def truth(self, tick: int) -> Truth | None:
        """Its true state of a tick, once all is heard."""
        return self._truths.get(tick * self.scenario.tick_ns)

    @cached_property
    def _truths(self) -> dict[int, Truth]:
        return {truth.t_ns: truth for truth in self.of(Truth)}

    def broadcast(self, tick: int) -> StateBroadcast | None:
        """Its first broadcast of a tick or later."""
        t_ns = tick * self.scenario.tick_ns
        return next((told for told in self.of(StateBroadcast) if told.t_ns >= t_ns), None)

    @cached_property
    def rows(self) -> MessageFates:
        """What it reports, once all is heard."""
        out: MessageFates = {}
        for report in self.of(DeliveryReport):
            named = zip(report.kinds, report.src, report.seqs, strict=True)
            told = zip(report.delivered_ns, report.fates, strict=True)
            for name, (delivered_ns, fate) in zip(named, told, strict=True):
                out.setdefault(name, []).append((report.t_ns, delivered_ns, fate))
        return out
