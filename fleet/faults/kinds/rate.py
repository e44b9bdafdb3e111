"""Rate: a link carries only so many bits a second."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults import quantities
from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, Effect, Floats, Harm, LinkRule
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice
from fleet.model.units import to_ns, to_s


@fault_kind
class Rate(LinkRule, frozen=True, tag="rate", kw_only=True):
    """Each directed link sends one message after the other.

    A message waits until those before it are through, and then takes its size divided by the rate.
    """

    bits_per_s: Annotated[float, Meta(ge=1.0, le=1e12, description="the rate")]
    queue: Annotated[
        int,
        Meta(
            ge=0,
            le=1_000_000,
            description="how many messages can wait; what finds as many waiting is dropped",
        ),
    ] = 100

    harms = Harm.DELAY | Harm.DROP
    by_order = True
    remembers = True
    by_size = True
    shorthands = (
        Shorthand(
            option="rate",
            metavar="RATE",
            help="Send only 9600bit, 100kbit or 1Mbit a second on each link.",
            example="100kbit",
            make=what("bits_per_s", quantities.bits_per_s),
        ),
    )

    def longest_s(self, bits: float = math.inf) -> float:
        """A full queue of the longest messages."""
        return (self.queue + 1) * bits / self.bits_per_s

    def act(self, _draws: Draws, _tick_ns: int) -> Act:
        """Delay by waiting and sending, or drop; messages of a link come in order of sending."""
        links: dict[tuple[int, int], deque[int]] = {}

        def send(link_message: LinkMessage, effect: Effect) -> bool:
            ends_ns = links.setdefault((link_message.src, link_message.dst), deque())
            while ends_ns and ends_ns[0] <= link_message.t_ns:
                ends_ns.popleft()
            if len(ends_ns) > self.queue:  # the first of them is not waiting, but being sent
                return False
            begin_ns = ends_ns[-1] if ends_ns else link_message.t_ns
            ends_ns.append(begin_ns + to_ns(link_message.bits / self.bits_per_s))
            effect.delay_s += to_s(ends_ns[-1] - link_message.t_ns)
            return True

        return send

    def passes(self, link: LinkMessage) -> None:
        """None: that depends on what else was sent."""

    def quantiles_s(self, parts: Floats) -> None:
        """None: that depends on what else was sent."""

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """From far too slow to just enough."""
        return {"bits_per_s": dice.choice((5000, 20_000, 60_000)), "queue": 10}
