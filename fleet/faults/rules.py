"""What the rules of a fault plan share: when, and whom or which links they concern.

Each kind of rule is in a module of its own, with what it does; `[[fault]]` in a scenario is a rule.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Annotated

from msgspec import Meta, Struct, field

from fleet.faults.draws import Draws, LinkMessage
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns
from fleet.protocol.classes import DELIVERY_ORDER

_TOLERANCE_S = 0.5e-9
"""Delays are in whole nanoseconds."""
LAST = 1_000_000
"""The highest number of a UAV."""

ONE = r"(coordinator|[1-9]\d{0,6}(-[1-9]\d{0,6})?)"
SOME = rf"{ONE}(,{ONE})*"
WHO = rf"^(\*|uav|{SOME})$"

Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
Delay = Annotated[float, Meta(ge=0.0, le=3600.0)]
RuleTime = Annotated[float, Meta(ge=0.0, le=1e9)]
Who = Annotated[str, Meta(pattern=WHO)]
_CLASS = rf"({'|'.join(DELIVERY_ORDER)})"
Classes = Annotated[str, Meta(pattern=rf"^(\*|{_CLASS}(,{_CLASS})*)$")]
RuleSpan = tuple[int, int]


class Rule(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """In force over [start_s, end_s) of simulated time; without `end_s`, for ever."""

    start_s: RuleTime = 0.0
    end_s: RuleTime | None = None  # not infinity, which JSON does not have

    @property
    def name(self) -> str:
        """Its kind, as in the scenario."""
        return str(self.__struct_config__.tag)

    def during(self, t_ns: int) -> bool:
        """Whether it is in force at a moment."""
        return to_ns(self.start_s) <= t_ns and (self.end_s is None or t_ns < to_ns(self.end_s))

    def idle(self, slack_s: float) -> str:
        """Why it does nothing with these values, to whomever and whenever; empty if it may.

        `slack_s` is what can be added to the delay of a message before it comes any later.
        """
        return ""


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


class LinkRule(Rule, frozen=True, kw_only=True):
    """A rule for messages of some classes from some to some, by the time of sending.

    What somebody sends to itself travels on no link: a UAV's command to itself, and the answer.
    """

    src: Who = "*"
    dst: Who = "*"
    classes: Classes = field(default="*", name="class")

    def concerns(self, link_message: LinkMessage) -> bool:
        """Whether a message on a link falls under this rule."""
        return (
            link_message.src != link_message.dst
            and self.during(link_message.t_ns)
            and (self.classes == "*" or link_message.kind in self.classes.split(","))
            and names(self.src, link_message.src)
            and names(self.dst, link_message.dst)
        )

    @property
    def longest_s(self) -> float:
        """The most that it adds to the delay of a message or of a copy."""
        return 0.0

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """What it does to one message after another, with the memory that this takes."""
        raise NotImplementedError


def never(probability: float) -> str:
    """Why a rule of this probability does nothing; empty if it may."""
    return "" if probability else "its probability is 0"


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


class NodeRule(Rule, frozen=True, kw_only=True):
    """A rule for some participants themselves."""

    node: Who

    def hits(self, number: int) -> bool:
        """Whether it is for this participant, at whatever time."""
        return names(self.node, number)


def names(who: str, number: int) -> bool:
    """Whether a pattern (`*`, `uav`, `coordinator`, "1-4,7") names this participant."""
    return any(low <= number <= high for low, high in spans(who))


@lru_cache(maxsize=1024)
def spans(who: str) -> tuple[RuleSpan, ...]:
    """First and last numbers that the parts of a pattern name; 0 is the coordinator."""
    return tuple(_span(part) for part in who.split(","))


def _span(part: str) -> RuleSpan:
    if part in _WORDS:
        return _WORDS[part]
    first, _, last = part.partition("-")
    return int(first), int(last or first)


_WORDS: dict[str, RuleSpan] = {
    "*": (COORDINATOR, LAST),
    "uav": (1, LAST),
    "coordinator": (COORDINATOR, COORDINATOR),
}
