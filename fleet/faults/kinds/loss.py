"""Loss: messages are lost, each by itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, ActTogether, Harm, LinkRule
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.quantities import fraction
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice, Probability, never


@fault_kind
class Loss(LinkRule, frozen=True, tag="loss", kw_only=True):
    """Loses each message by itself."""

    probability: Annotated[Probability, Meta(description="of each message")]

    harms = Harm.DROP
    shorthands = (
        Shorthand(
            option="loss",
            metavar="P",
            help="Lose messages, as 20% or 0.2, on each link by itself.",
            example="20%",
            make=what("probability", fraction),
        ),
    )

    def idle(self, _slack_s: float) -> str:
        """Why it loses nothing."""
        return never(self.probability)

    def act(self, draws: Draws, _tick_ns: int) -> Act:
        """Drop it, if its draw says so; what a low probability drops, a higher one drops too."""
        return lambda link_message, _: draws.of_message("loss", link_message) >= self.probability

    def act_together(self, _act: Act, draws: Draws) -> ActTogether:
        """The same to several."""
        return lambda sent: (
            np.zeros(len(sent.src)),
            draws.of_message("loss", sent) >= self.probability,
        )

    def passes(self, _link: LinkMessage) -> float:
        """1 - probability."""
        return 1.0 - self.probability

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """From hardly any to all."""
        return {"probability": dice.choice((0.05, 0.3, 0.6, 0.95, 1.0))}
