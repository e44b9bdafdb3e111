"""Slow: a process steps too seldom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults import quantities
from fleet.faults.lifecycle import HELD, UP, ProcessRule, Severity
from fleet.faults.options import RuleTable, Shorthand, whom_what
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice


@fault_kind
class Slow(ProcessRule, frozen=True, tag="slow", kw_only=True):
    """The process steps only in some ticks; its aircraft holds the last command meanwhile."""

    factor: Annotated[int, Meta(ge=2, le=1000, description="it steps in every so many-th tick")]

    shorthands = (
        Shorthand(
            option="slow",
            metavar="WHO:N",
            help="Let a process step only every N-th tick, as 2:4@50s+10s.",
            example="2:4@50s+10s",
            make=whom_what("factor", quantities.factor, "2:4@50s+10s"),
        ),
    )

    @property
    def severity(self) -> Severity:
        """Some steps."""
        return Severity.SOME_STEPS

    def presence(self, n: int) -> str:
        """It steps in the first tick, and in every so many-th after it."""
        return HELD if n % self.factor else UP

    def outdoes(self, other: ProcessRule, apart: int) -> bool:
        """One that is as slow, in the same ticks."""
        return isinstance(other, Slow) and self.factor == other.factor and apart % self.factor == 0

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """A little or very."""
        return {"factor": dice.choice((2, 5, 20))}
