"""Pause: a process is stopped for a while."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.faults.lifecycle import ProcessRule, Severity
from fleet.faults.options import RuleTable, Shorthand, whom
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice


@fault_kind
class Pause(ProcessRule, frozen=True, tag="pause", kw_only=True):
    """The process is stopped from `start_s` to `end_s`; its aircraft holds the last command.

    It has no further keys.
    """

    shorthands = (
        Shorthand(
            option="pause",
            metavar="WHO@TIME",
            help="Stop a process for a while, as 3@50s+5s.",
            example="3@50s+5s",
            make=whom(timed=True),
            timed=True,
        ),
    )

    @property
    def severity(self) -> Severity:
        """All steps."""
        return Severity.STEPS

    @classmethod
    def fuzzed(cls, _dice: Dice, _: Sequence[int]) -> RuleTable:
        """There is nothing to draw."""
        return {}
