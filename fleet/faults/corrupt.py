"""Corrupt: bits of messages are flipped."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.rules import Act, Effect, LinkRule, Probability, never


class Corrupt(LinkRule, frozen=True, tag="corrupt", kw_only=True):
    """With `probability` `bits` bits of a message, chosen at random, are flipped.

    With a frame check, which every real link has, such a message is rejected by the link; without
    it the flipped bits reach the decoder.
    """

    probability: Probability
    bits: Annotated[int, Meta(ge=1, le=64)] = 1
    frame_check: bool = True

    def idle(self, slack_s: float) -> str:
        """Why it flips nothing."""
        return never(self.probability)

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Flip bits, if the draw says so."""

        def flip(link_message: LinkMessage, course: Effect) -> bool:
            if draws.of_message("corrupt", link_message) >= self.probability:
                return True
            course.flips += tuple(
                draws.of_message("bit", link_message, n) for n in range(self.bits)
            )
            return not self.frame_check

        return flip
