"""Clock: a participant's clock is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults.rules import NodeRule, Rule
from fleet.model.units import to_ns


class ClockError(NodeRule, frozen=True, tag="clock", kw_only=True):
    """The clock is ahead by `offset_s`, and gains `drift_ppm` from the start of the window on."""

    offset_s: Annotated[float, Meta(ge=-3600.0, le=3600.0)] = 0.0
    drift_ppm: Annotated[float, Meta(ge=-1e5, le=1e5)] = 0.0

    def idle(self, slack_s: float) -> str:
        """Why the clock is right."""
        wrong = to_ns(self.offset_s) or self.drift_ppm
        return "" if wrong else "offset_s and drift_ppm are 0"

    def shift_ns(self, now_ns: int) -> int:
        """By how much it is ahead while the rule is in force."""
        gained = self.drift_ppm * 1e-6 * (now_ns - to_ns(self.start_s))
        return to_ns(self.offset_s) + round(gained)


class LocalClock:
    """The clock of one participant, under one plan."""

    def __init__(self, plan: Sequence[Rule], node: int) -> None:
        self._node = node
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on."""
        self._rules = [r for r in plan if isinstance(r, ClockError) and r.hits(self._node)]

    @property
    def clean(self) -> bool:
        """Whether it is always right."""
        return not self._rules

    def shift_ns(self, now_ns: int) -> int:
        """Its reading minus true time."""
        if not self._rules:
            return 0
        return sum(rule.shift_ns(now_ns) for rule in self._rules if rule.during(now_ns))
