"""Duplicate: messages come twice."""

from __future__ import annotations

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.rules import Act, Delay, Effect, LinkRule, Probability, never


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

        def copy(link_message: LinkMessage, course: Effect) -> bool:
            if draws.of_message(self.name, link_message) < self.probability:
                course.copies_s += (self.delay_s,)
            return True

        return copy
