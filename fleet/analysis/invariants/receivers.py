"""Who is to hear each message: whom it is for, and who was within radio range of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from functools import cached_property

from fleet.analysis.earshots import Earshots
from fleet.config.scenario import Scenario
from fleet.protocol.messages import AddressedMessage, Message, Truth

MARGINS = 2.0
"""Realtime: the moment of hearing is not on record; sender and receiver may have flown so far."""


class Receivers:
    """Of one run. Without a radio range everybody for whom a message is is to hear it.

    In lockstep true states tell exactly who was within range. In realtime there are some who may
    have been, and of a process that is stopped at times nothing is known.
    """

    def __init__(
        self,
        scenario: Scenario,
        truths: Callable[[], Iterable[Truth]],
        deaf: Collection[int],
        unsure: Collection[int] | None,
    ) -> None:
        """`truths` are asked for if there is a range; `unsure` who is stopped; None: lockstep."""
        self._scenario, self._radio = scenario, scenario.radio()
        self._truths, self._deaf, self._unsure = truths, deaf, unsure

    @property
    def limited(self) -> bool:
        """Whether there is a radio range."""
        return self._radio.limited

    def may_hear(self, receiver: int, message: Message) -> bool:
        """Whether a message is for a receiver, who may have been within range."""
        if receiver in self._deaf or not message.is_for(receiver):
            return False
        if not self.limited or (self._unsure and receiver in self._unsure):
            return True
        return self._possible.hears(message.id, receiver, message.t_ns)

    def within_range(self, uavs: Iterable[int], t_ns: int) -> bool:
        """Whether all of these, of whom the coordinator may be one, surely hear each other."""
        numbers = [*uavs]
        return all(self._sure.hears(a, b, t_ns) for a in numbers for b in numbers)

    def of(self, message: Message, *, surely: bool) -> Iterable[int]:
        """Who hears a message, if there is a range; sooner where messages come in order of time."""
        earshots = self._sure if surely else self._possible
        if isinstance(message, AddressedMessage):
            reached = earshots.hears(message.id, message.target, message.t_ns)
            hearers: Iterable[int] = (message.target,) if reached else ()
        else:
            hearers = earshots.hearers(message.id, message.t_ns)
        but = (self._unsure or ()) if surely else ()
        return [n for n in hearers if n not in self._deaf and n not in but and message.is_for(n)]

    @cached_property
    def _possible(self) -> Earshots:
        return self._earshots(MARGINS)

    @cached_property
    def _sure(self) -> Earshots:
        return self._possible if self._unsure is None else self._earshots(-MARGINS)

    def _earshots(self, margins: float) -> Earshots:
        by_m = 0.0 if self._unsure is None else margins * self._radio.margin_m
        return Earshots(self._scenario, self._truths(), self._radio.changed(by_m))
