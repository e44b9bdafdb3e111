"""Reorder: messages are overtaken by later ones."""

from __future__ import annotations

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.rules import Act, Delay, Effect, LinkRule, Probability, never, too_short


class Reorder(LinkRule, frozen=True, tag="reorder", kw_only=True):
    """With `probability` a message is held back for `delay_s`, so that later ones overtake it."""

    probability: Probability
    delay_s: Delay = 1.0

    @property
    def longest_s(self) -> float:
        """For how long it holds back."""
        return self.delay_s

    def idle(self, slack_s: float) -> str:
        """Why it holds nothing back."""
        return never(self.probability) or too_short(self.longest_s, slack_s)

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Add to the delay, if the draw says so."""

        def hold(link_message: LinkMessage, course: Effect) -> bool:
            if draws.of_message("reorder", link_message) < self.probability:
                course.delay_s += self.delay_s
            return True

        return hold
