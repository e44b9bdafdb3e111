"""Burst: messages are lost together, while a link is bad."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.rules import Act, Effect, LinkRule, never


class Burst(LinkRule, frozen=True, tag="burst", kw_only=True):
    """Gilbert-Elliott: a link is good or bad from tick to tick; a bad one loses everything.

    Given as the mean loss L and the mean length b of a burst in ticks: r = 1/b, p = L r / (1 - L)
    (Gilbert, 1960; Elliott, 1963).
    """

    loss: Annotated[float, Meta(ge=0.0, lt=1.0)]
    mean_ticks: Annotated[float, Meta(ge=1.0, le=1e6)] = 5.0

    @property
    def leave(self) -> float:
        """Probability r that a bad link becomes good in a tick."""
        return 1.0 / self.mean_ticks

    @property
    def enter(self) -> float:
        """Probability p that a good link becomes bad in a tick."""
        return self.loss * self.leave / (1.0 - self.loss)

    def idle(self, slack_s: float) -> str:
        """Why it loses nothing."""
        return never(self.loss)

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Drop what is sent while its directed link is bad."""
        chains: dict[tuple[int, int], bytearray] = {}

        def good(link_message: LinkMessage, _: Effect) -> bool:
            chain = chains.setdefault((link_message.src, link_message.dst), bytearray())
            tick = link_message.t_ns // tick_ns
            while len(chain) <= tick:
                uniform = draws.uniform("burst", link_message.src, link_message.dst, len(chain))
                chain.append(self._next(chain, uniform))
            return not chain[tick]

        return good

    def _next(self, chain: bytearray, uniform: float) -> bool:
        """Whether a link is bad in the tick after those of `chain`."""
        if not chain:
            return uniform < self.loss  # the chain starts in its stationary state
        return uniform >= self.leave if chain[-1] else uniform < self.enter
