"""What all rules of a fault plan share: when they are in force, and what a kind tells of itself.

Each kind is a class in a module of its own (`fleet.faults.kinds`) that says all that the project
knows of it; `[[fault]]` in a scenario is a rule. There are four groups of them: rules about links
(`links`), processes (`lifecycle`), sensors (`sensors`) and clocks (`clock`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, ClassVar, Protocol, Self, TypeVar

import msgspec
from msgspec import Meta, Struct

from fleet.faults.draws import Draws
from fleet.faults.options import RuleTable, Shorthand, Variation
from fleet.faults.whom import Who, names
from fleet.model.units import to_ns, to_s

Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
Delay = Annotated[float, Meta(ge=0.0, le=3600.0)]
RuleTime = Annotated[float, Meta(ge=0.0, le=1e9)]
RuleSeed = Annotated[int, Meta(ge=0, le=2**63 - 1)]

_T = TypeVar("_T")


class Dice(Protocol):
    """What random cases are drawn with: a `random.Random`."""

    def random(self) -> float:
        """Uniform in [0, 1)."""
        ...

    def choice(self, seq: Sequence[_T], /) -> _T:
        """One of these."""
        ...


class Rule(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """In force over [start_s, end_s) of simulated time; without `end_s`, for ever."""

    start_s: Annotated[
        RuleTime,
        Meta(
            description="when the rule comes into force, in simulated time; for a message the "
            "time of sending counts"
        ),
    ] = 0.0
    end_s: Annotated[RuleTime | None, Meta(description="when it ends; without it never")] = (
        None  # not infinity, which JSON does not have
    )
    seed: Annotated[
        RuleSeed | None,
        Meta(description="seed of its random numbers; without it that of the scenario"),
    ] = None

    shorthands: ClassVar[tuple[Shorthand | Variation, ...]] = ()
    """The options of the command line that stand for rules of this kind."""

    who_keys: ClassVar[tuple[str, ...]] = ()
    """The keys that are patterns of participants."""

    @classmethod
    def unsaid(cls) -> Iterator[str]:
        """Names of what a kind has to say of itself, and this one does not."""
        yield from not_overridden(cls, Rule, ("fuzzed",))

    @property
    def name(self) -> str:
        """Its kind, as in the scenario."""
        return str(self.__struct_config__.tag)

    def during(self, t_ns: int) -> bool:
        """Whether it is in force at a moment."""
        return to_ns(self.start_s) <= t_ns and (self.end_s is None or t_ns < to_ns(self.end_s))

    def bounds_ns(self) -> tuple[int, ...]:
        """When it begins, and when it ends, if it does."""
        start_ns = to_ns(self.start_s)
        return (start_ns,) if self.end_s is None else (start_ns, to_ns(self.end_s))

    def draws(self, seed: int, place: int) -> Draws:
        """Its random numbers, in a scenario of this seed and at this place of the plan."""
        return Draws(seed if self.seed is None else self.seed, place)

    def ended(self, now_ns: int) -> Self:
        """The same rule, over by now; one that has not begun will not."""
        if self.end_s is not None and to_ns(self.end_s) <= now_ns:
            return self
        return msgspec.structs.replace(self, end_s=max(to_s(now_ns), self.start_s))

    def problems(self, everybody: Sequence[int]) -> Iterator[tuple[str, str]]:
        """What makes it impossible, by key; `everybody` is who can take part, by number."""
        yield from ()

    def idle(self, slack_s: float) -> str:
        """Why it does nothing with these values, to whomever and whenever; empty if it may.

        `slack_s` is what can be added to the delay of a message before it comes any later.
        """
        return ""

    def words(self, *, when: bool = False) -> str:
        """Kind and keys, as in `loss probability=0.3`, without what is as by default.

        The window is left out but for `when`.
        """
        given = [
            f"{f.encode_name}={value:g}" if isinstance(value, float) else f"{f.encode_name}={value}"
            for f in msgspec.structs.fields(self)
            if (value := getattr(self, f.name)) != f.default
            and (when or f.name not in ("start_s", "end_s"))
        ]
        return " ".join([self.name, *given])

    @classmethod
    def fuzzed(cls, dice: Dice, numbers: Sequence[int], /) -> RuleTable:
        """The keys of its own of a random rule, for a fleet of these UAVs; None: no such key."""
        raise NotImplementedError

    @classmethod
    def fuzzed_whom(cls, dice: Dice, numbers: Sequence[int], /) -> RuleTable:
        """Whom a random rule concerns."""
        raise NotImplementedError


class NodeRule(Rule, frozen=True, kw_only=True):
    """A rule for some participants themselves."""

    node: Annotated[Who, Meta(description="whose")]

    who_keys = ("node",)

    of_uavs: ClassVar[bool] = False
    """Whether it can concern UAVs alone."""

    def hits(self, number: int) -> bool:
        """Whether it is for this participant, at whatever time."""
        return names(self.node, number)

    @classmethod
    def fuzzed_whom(cls, dice: Dice, numbers: Sequence[int]) -> RuleTable:
        """A UAV, often the first, or as often as that the coordinator."""
        return {"node": str(dice.choice(numbers)) if cls.of_uavs else somebody(dice, numbers)}


def somebody(dice: Dice, numbers: Sequence[int]) -> str:
    """Some participant; those by which most is lost, coordinator and first UAV, more often."""
    return dice.choice([*map(str, numbers), "coordinator", str(min(numbers)), "coordinator"])


def not_overridden(cls: type[Rule], base: type[Rule], names: Iterable[str]) -> Iterator[str]:
    """Names of those methods and properties of a base that a kind has to make its own, but has."""
    for name in names:
        mine, its = (getattr(c, name, None) for c in (cls, base))
        if getattr(mine, "__func__", mine) is getattr(its, "__func__", its):
            yield name


def never(probability: float) -> str:
    """Why a rule of this probability does nothing; empty if it may."""
    return "" if probability else "its probability is 0"
