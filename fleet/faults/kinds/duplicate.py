"""Duplicate: messages come twice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, Effect, Harm, LinkRule
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.quantities import fraction
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Delay, Dice, Probability, never


@fault_kind
class Duplicate(LinkRule, frozen=True, tag="duplicate", kw_only=True):
    """Delivers a message once more."""

    probability: Annotated[Probability, Meta(description="of each message")]
    delay_s: Annotated[Delay, Meta(description="how much later than the first time")] = 0.0

    harms = Harm.COPY
    shorthands = (
        Shorthand(
            option="duplicate",
            metavar="P",
            help="Deliver messages twice with this probability.",
            example="1%",
            make=what("probability", fraction),
        ),
    )

    def longest_s(self, _bits: float = math.inf) -> float:
        """How much later a copy comes."""
        return self.delay_s

    def idle(self, _slack_s: float) -> str:
        """Why it copies nothing."""
        return never(self.probability)

    def act(self, draws: Draws, _tick_ns: int) -> Act:
        """Add a copy, if the draw says so."""

        def copy(link_message: LinkMessage, effect: Effect) -> bool:
            if draws.of_message(self.name, link_message) < self.probability:
                effect.copies_s += (self.delay_s,)
            return True

        return copy

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """At once or later."""
        return {"probability": dice.choice((0.3, 1.0)), "delay_s": dice.choice((0.0, 0.3, 2.0))}
