"""Duplicate: messages come twice."""

from __future__ import annotations

from fleet.model.faults.draws import Draws, Hop
from fleet.model.faults.rules import Act, Course, Delay, LinkRule, Probability, never


class Duplicate(LinkRule, frozen=True, tag="duplicate", kw_only=True):
    """With `probability` a message is delivered once more, `delay_s` after the first time."""

    probability: Probability
    delay_s: Delay = 0.0

    @property
    def longest_s(self) -> float:
        """How much later a copy comes."""
        return self.delay_s

    def idle(self, slack_s: float) -> str:
        """Why it copies nothing."""
        return never(self.probability)

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Add a copy, if the draw says so."""

        def copy(hop: Hop, course: Course) -> bool:
            if draws.of_hop(self.name, hop) < self.probability:
                course.copies_s += (self.delay_s,)
            return True

        return copy
