"""Rules about links: what becomes of a message on its way from one participant to another."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from enum import Flag, auto
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta, field
from numpy.typing import NDArray

from fleet.faults.draws import Draws, LinkMessage, LinkMessageColumns
from fleet.faults.options import RuleTable
from fleet.faults.rules import Dice, Rule, not_overridden, somebody
from fleet.faults.whom import Who, names, spans
from fleet.model.types import Truths
from fleet.model.units import to_ns
from fleet.protocol.classes import DELIVERY_ORDER

_TOLERANCE_S = 0.5e-9
"""Delays are in whole nanoseconds."""

_CLASS = rf"({'|'.join(DELIVERY_ORDER)})"
_TOLD = f'{", ".join(f"`{kind}`" for kind in DELIVERY_ORDER)}, or several: `"cmd,ack"`; `*` is all'
Classes = Annotated[str, Meta(pattern=rf"^(\*|{_CLASS}(,{_CLASS})*)$", description=_TOLD)]

FUZZED_CLASSES = (
    "*",
    "*",
    "adsb",
    "election",
    "cmd",
    "ack",
    "heartbeat",
    "cmd,ack",
    "election,heartbeat",
)

UNREADABLE = "corrupt"
"""The fate of a message whose flipped bits leave nothing that can be read."""

Floats = NDArray[np.float64]


class Harm(Flag):
    """What a kind of rule can do to a message."""

    DROP = auto()
    DELAY = auto()
    COPY = auto()
    ALTER = auto()


class Effect:
    """What rules have made of a message so far: its delay, further copies, bits to be flipped.

    A copy is how much later it comes than the message itself; a flip is a place in [0, 1).
    """

    __slots__ = ("copies_s", "delay_s", "flips")

    def __init__(self) -> None:
        self.delay_s = 0.0
        self.copies_s: tuple[float, ...] = ()
        self.flips: tuple[float, ...] = ()


Act = Callable[[LinkMessage, Effect], bool]
"""What a rule does to a message that it concerns; false if the message is dropped."""

ActTogether = Callable[[LinkMessageColumns], tuple[Floats, Truths]]
"""The same to n messages at once: what it adds to their delays, and which it does not drop."""


class LinkRule(Rule, frozen=True, kw_only=True):
    """A rule for messages of some classes from some to some, by the time of sending.

    What somebody sends to itself travels on no link: a UAV's command to itself, and the answer.
    """

    src: Annotated[Who, Meta(description="whose messages")] = "*"
    dst: Annotated[Who, Meta(description="on the way to whom")] = "*"
    classes: Classes = field(default="*", name="class")

    who_keys: ClassVar[tuple[str, ...]] = ("src", "dst")

    harms: ClassVar[Harm]
    """What it can do. Each kind has to say it, and what goes with it: see `unsaid`."""

    copies: ClassVar[int] = 1
    """How many further copies of a message it makes at most, if it copies."""

    by_distance: ClassVar[bool] = False
    """Whether what it does depends on how far apart sender and receiver are."""

    by_size: ClassVar[bool] = False
    """Whether it depends on how many bits a message has."""

    remembers: ClassVar[bool] = False
    """Whether what it does goes on from one tick to the next, so that it cannot be cut in two."""

    by_order: ClassVar[bool] = False
    """Whether it depends on which messages came before: in realtime no log tells that."""

    @classmethod
    def unsaid(cls) -> Iterator[str]:
        """Names of what a kind has to say of itself, and this one does not."""
        yield from super().unsaid()
        if not isinstance(getattr(cls, "harms", None), Harm):
            yield "harms"
            return
        needed = ["act"]
        needed += ["passes"] if cls.harms & Harm.DROP else []
        needed += ["longest_s"] if cls.harms & (Harm.DELAY | Harm.COPY) else []
        needed += ["quantiles_s"] if cls.harms & Harm.DELAY else []
        yield from not_overridden(cls, LinkRule, needed)

    def concerns(self, link_message: LinkMessage) -> bool:
        """Whether a message on a link falls under this rule."""
        return self.during(link_message.t_ns) and self.concerns_link(
            link_message.src, link_message.dst, link_message.kind
        )

    def concerns_link(self, src: int, dst: int, kind: str) -> bool:
        """Whether messages of a class on a link do while the rule is in force."""
        return (
            src != dst
            and self.concerns_class(kind)
            and names(self.src, src)
            and names(self.dst, dst)
        )

    def concerns_each(self, sent: LinkMessageColumns) -> Truths:
        """Whether each of several messages falls under this rule."""
        if (
            not self.during(sent.t_ns)
            or not self.concerns_class(sent.kind)
            or not names(self.dst, sent.dst)
        ):
            return np.zeros(len(sent.src), dtype=np.bool_)
        others: Truths = sent.src != sent.dst
        named = np.zeros(len(sent.src), dtype=np.bool_)
        for low, high in spans(self.src):
            named |= (low <= sent.src) & (sent.src <= high)
        return others & named

    def concerns_class(self, kind: str) -> bool:
        """Whether messages of a class fall under this rule."""
        return self.classes == "*" or kind in self.classes.split(",")

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """What it does to one message after another, with the memory that this takes."""
        raise NotImplementedError

    def act_together(self, act: Act, draws: Draws) -> ActTogether:
        """The same as `act` to several messages at once; one after another, if nothing is faster.

        Kinds that copy or alter messages, or go `by_order`, are never asked.
        """

        def one_by_one(sent: LinkMessageColumns) -> tuple[Floats, Truths]:
            effects = [Effect() for _ in sent.src]
            passed = [act(sent.one(n), effect) for n, effect in enumerate(effects)]
            return np.array([effect.delay_s for effect in effects]), np.array(passed)

        return one_by_one

    def passes(self, link: LinkMessage) -> float | None:
        """Probability that a message on a link is not dropped; None if that has no closed form.

        Of the message only source, receiver and class are given; where a kind goes `by_distance`,
        distance and bits too.
        """
        return 1.0

    def longest_s(self, bits: float = math.inf) -> float:
        """The most that it adds to the delay of a message or copy, if none has more bits."""
        return 0.0

    def quantiles_s(self, parts: Floats) -> Floats | None:
        """The delay that it adds, as quantiles at these probabilities, rising, shape (n,).

        None if that has no closed form.
        """
        return np.zeros(len(parts))

    def between(self, src: int, dst: int) -> bool:
        """Whether it can do anything on this link, if its patterns name both ends."""
        return True

    def trait(self, number: int) -> Hashable:
        """What it treats a participant by, besides its patterns: those alike are treated alike."""
        return None

    @classmethod
    def fuzzed_whom(cls, dice: Dice, numbers: Sequence[int]) -> RuleTable:
        """Any class, and now and then from somebody, or to somebody."""
        return {"class": dice.choice(FUZZED_CLASSES), **fuzzed_ends(dice, numbers)}


def fuzzed_ends(dice: Dice, numbers: Sequence[int]) -> RuleTable:
    """Now and then from somebody, or to somebody."""
    return {end: somebody(dice, numbers) for end in ("src", "dst") if dice.random() < 0.3}


def too_short(longest_s: float, slack_s: float) -> str:
    """Why a rule that delays by so much at most does nothing; empty if it may."""
    if to_ns(longest_s) == 0:
        return "it delays by 0 s"
    if longest_s > slack_s + _TOLERANCE_S:
        return ""
    return (
        f"it delays by {longest_s:g} s at most, and in lockstep every message takes a tick at the "
        "least, which hides that"
    )
