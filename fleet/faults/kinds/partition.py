"""Partition: the network falls apart into groups."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage, LinkMessageColumns
from fleet.faults.links import Act, ActTogether, Floats, Harm, LinkRule
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice
from fleet.faults.whom import SOME, names
from fleet.model.types import Truths


@fault_kind
class Partition(LinkRule, frozen=True, tag="partition", kw_only=True):
    """Nothing passes between the groups; who is in none of them hears everybody, and is heard.

    Who is in two of them hears both: `1,2/2,3` parts 1 from 3. Groups that part nobody are refused.
    """

    groups: Annotated[
        str,
        Meta(
            pattern=rf"^{SOME}(/{SOME})+$",
            description='two lists or more, with `/` between: `"1,2/3,4"`, `"1-3/4,coordinator"`',
        ),
    ]

    who_keys = ("src", "dst", "groups")
    harms = Harm.DROP
    shorthands = (
        Shorthand(
            option="partition",
            metavar="GROUPS",
            help="Cut the network between groups, as 1-2/3,4,coordinator.",
            example="1-2/3,4@60s+30s",
            make=what("groups", str),
        ),
    )

    def problems(self, everybody: Sequence[int]) -> Iterator[tuple[str, str]]:
        """There must be two whom it parts, one in `src`, the other in `dst`."""
        sources = {self.trait(n) for n in everybody if names(self.src, n)}
        receivers = {self.trait(n) for n in everybody if names(self.dst, n)}
        if not any(a and b and not a & b for a in sources for b in receivers):
            yield (
                "groups",
                f"'{self.groups}' parts nobody from anybody; put those who shall not "
                "hear each other on different sides, as 1-2/3,4",
            )

    def act(self, _draws: Draws, _tick_ns: int) -> Act:
        """Drop what crosses."""
        return lambda link_message, _: not self.between(link_message.src, link_message.dst)

    def act_together(self, _act: Act, _draws: Draws) -> ActTogether:
        """The same to several."""
        links: dict[tuple[int, int], bool] = {}

        def within(sent: LinkMessageColumns) -> tuple[Floats, Truths]:
            ends = [(src, sent.dst) for src in sent.src.tolist()]
            for end in ends:
                if end not in links:
                    links[end] = not self.between(*end)
            return np.zeros(len(ends)), np.array([links[end] for end in ends])

        return within

    def passes(self, link: LinkMessage) -> float:
        """0 across, else 1."""
        return float(not self.between(link.src, link.dst))

    def between(self, src: int, dst: int) -> bool:
        """Whether source and receiver are both on a side, but on none together."""
        of_src, of_dst = self.trait(src), self.trait(dst)
        return bool(of_src and of_dst and not of_src & of_dst)

    def trait(self, number: int) -> frozenset[int]:
        """The groups that a participant is in, by their place."""
        groups = enumerate(self.groups.split("/"))
        return frozenset(n for n, group in groups if names(group, number))

    @classmethod
    def fuzzed(cls, dice: Dice, numbers: Sequence[int]) -> RuleTable:
        """Everybody on one of two sides."""
        sides: tuple[list[str], list[str]] = ([], [])
        for name in [*map(str, numbers), "coordinator"]:
            sides[dice.random() < 0.5].append(name)
        if not sides[0] or not sides[1]:
            both = sides[0] + sides[1]
            sides = ([both[0]], both[1:])
        return {"groups": "/".join(",".join(side) for side in sides)}

    @classmethod
    def fuzzed_whom(cls, _dice: Dice, _: Sequence[int]) -> RuleTable:
        """All messages of all."""
        return {}
