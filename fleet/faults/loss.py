"""Loss: messages are lost, each by itself."""

from __future__ import annotations

from fleet.faults.draws import Draws
from fleet.faults.rules import Act, LinkRule, Probability, never


class Loss(LinkRule, frozen=True, tag="loss", kw_only=True):
    """Each message is lost with `probability`, independently on every link."""

    probability: Probability

    def idle(self, slack_s: float) -> str:
        """Why it loses nothing."""
        return never(self.probability)

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Drop it, if its draw says so; what a low probability drops, a higher one drops too."""
        return lambda link_message, _: draws.of_message("loss", link_message) >= self.probability
