"""Corrupt: bits of messages are flipped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, Effect, Harm, LinkRule, fuzzed_ends
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.quantities import fraction
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice, Probability, never


@fault_kind
class Corrupt(LinkRule, frozen=True, tag="corrupt", kw_only=True):
    """Flips bits, anywhere in a message."""

    probability: Annotated[Probability, Meta(description="of each message")]
    bits: Annotated[int, Meta(ge=1, le=64, description="how many")] = 1
    frame_check: Annotated[
        bool,
        Meta(
            description="a corrupted message is rejected by the link, as by every real one; "
            "without it the bits reach the decoder, which rejects what is not well-formed any more"
        ),
    ] = True

    harms = Harm.DROP | Harm.ALTER
    shorthands = (
        Shorthand(
            option="corrupt",
            metavar="P",
            help="Flip a bit with this probability; links reject what is corrupted.",
            example="0.5%",
            make=what("probability", fraction),
        ),
    )

    def idle(self, _slack_s: float) -> str:
        """Why it flips nothing."""
        return never(self.probability)

    def act(self, draws: Draws, _tick_ns: int) -> Act:
        """Flip bits, if the draw says so."""

        def flip(link_message: LinkMessage, effect: Effect) -> bool:
            if draws.of_message("corrupt", link_message) >= self.probability:
                return True
            effect.flips += tuple(
                draws.of_message("bit", link_message, n) for n in range(self.bits)
            )
            return not self.frame_check

        return flip

    def passes(self, _link: LinkMessage) -> float | None:
        """1 - probability with a frame check; none without: that depends on which bits flip."""
        return 1.0 - self.probability if self.frame_check else None

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """Few or many bits, rejected by the link or not."""
        return {
            "probability": dice.choice((0.02, 0.3)),
            "bits": dice.choice((1, 4)),
            "frame_check": dice.random() < 0.5,
        }

    @classmethod
    def fuzzed_whom(cls, dice: Dice, numbers: Sequence[int]) -> RuleTable:
        """Broadcasts alone: no protocol stands commands that say something else."""
        return {"class": "adsb", **fuzzed_ends(dice, numbers)}
