"""Reorder: messages are overtaken by later ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage, LinkMessageColumns
from fleet.faults.links import Act, ActTogether, Effect, Floats, Harm, LinkRule, too_short
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.quantities import fraction
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Delay, Dice, Probability, never
from fleet.model.types import Truths


@fault_kind
class Reorder(LinkRule, frozen=True, tag="reorder", kw_only=True):
    """Holds a message back, so that later ones overtake it."""

    probability: Annotated[Probability, Meta(description="of each message")]
    delay_s: Annotated[Delay, Meta(description="for how long")] = 1.0

    harms = Harm.DELAY
    shorthands = (
        Shorthand(
            option="reorder",
            metavar="P",
            help="Hold messages back for 1 s with this probability.",
            example="10%",
            make=what("probability", fraction),
        ),
    )

    def longest_s(self, _bits: float = math.inf) -> float:
        """For how long it holds back."""
        return self.delay_s

    def idle(self, slack_s: float) -> str:
        """Why it holds nothing back."""
        return never(self.probability) or too_short(self.longest_s(), slack_s)

    def act(self, draws: Draws, _tick_ns: int) -> Act:
        """Add to the delay, if the draw says so."""

        def hold(link_message: LinkMessage, effect: Effect) -> bool:
            if draws.of_message("reorder", link_message) < self.probability:
                effect.delay_s += self.delay_s
            return True

        return hold

    def act_together(self, _act: Act, draws: Draws) -> ActTogether:
        """The same to several."""

        def hold(sent: LinkMessageColumns) -> tuple[Floats, Truths]:
            held = draws.of_message("reorder", sent) < self.probability
            return np.where(held, self.delay_s, 0.0), np.ones(len(held), dtype=np.bool_)

        return hold

    def quantiles_s(self, parts: Floats) -> None:
        """Not worked out."""

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """By a few messages or many."""
        return {"probability": 0.3, "delay_s": dice.choice((0.3, 1.5))}
