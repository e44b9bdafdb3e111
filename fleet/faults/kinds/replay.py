"""Replay: messages come again when they are old."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.quantities import fraction
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Delay, Dice


@fault_kind
class Replay(Duplicate, frozen=True, tag="replay", kw_only=True):
    """Delivers a message once more when it is old.

    So does an attacker who sends recorded messages again.
    """

    delay_s: Annotated[Delay, Meta(description="how much later than the first time")] = 5.0

    shorthands = (
        Shorthand(
            option="replay",
            metavar="P",
            help="Deliver messages again 5 s later with this probability.",
            example="1%",
            make=what("probability", fraction),
        ),
    )

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """Before and after commands have expired."""
        return {"probability": dice.choice((0.1, 0.5)), "delay_s": dice.choice((1.0, 5.0, 12.0))}
