"""Burst: messages are lost together, while a link is bad."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, Effect, Harm, LinkRule
from fleet.faults.options import RuleTable, Variation
from fleet.faults.quantities import count
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice, never

TICKS_KEPT = 4096
"""So many ticks of each link are remembered: messages may come so late."""


def _in_bursts(loss: RuleTable, mean_ticks: float) -> RuleTable:
    """The keys of a rule that loses as much as a `loss` does."""
    rest = {key: value for key, value in loss.items() if key != "probability"}
    return {"loss": loss["probability"], "mean_ticks": mean_ticks, **rest}


class _Chain:
    """A link from tick to tick: whether it is `bad` in those from `first` on, before `end`.

    What is long ago is forgotten, and computed again in the rare case that it is asked for.
    """

    def __init__(self) -> None:
        self.first, self.bad = 0, bytearray()

    @property
    def end(self) -> int:
        """The tick that is next."""
        return self.first + len(self.bad)

    def add(self, bad: int) -> None:
        """Go on by a tick."""
        self.bad.append(bad)
        if len(self.bad) > 2 * TICKS_KEPT:
            del self.bad[:TICKS_KEPT]
            self.first += TICKS_KEPT


@fault_kind
class Burst(LinkRule, frozen=True, tag="burst", kw_only=True):
    """Loses messages in bursts (Gilbert, 1960; Elliott, 1963).

    Each directed link is good or bad from tick to tick; a bad one loses everything, a good one
    nothing. With the mean loss L and the mean length b of a burst in ticks a bad link becomes good
    with probability r = 1/b, a good one bad with p = L r / (1 - L).
    """

    loss: Annotated[float, Meta(ge=0.0, lt=1.0, description="mean loss")]
    mean_ticks: Annotated[
        float,
        Meta(
            ge=1.0,
            le=1e6,
            description="mean length of a burst, at least `loss / (1 - loss)`: a link is good for "
            "one tick between two",
        ),
    ] = 5.0

    harms = Harm.DROP
    remembers = True
    shorthands = (
        Variation(
            option="burst",
            metavar="TICKS",
            help="Lose them in bursts of this mean length.",
            example="5",
            of="loss",
            parse=count,
            vary=_in_bursts,
            needs="needs --loss, the mean loss that its bursts make up",
        ),
    )

    @property
    def leave(self) -> float:
        """Probability r that a bad link becomes good in a tick."""
        return 1.0 / self.mean_ticks

    @property
    def enter(self) -> float:
        """Probability p that a good link becomes bad in a tick."""
        return self.loss * self.leave / (1.0 - self.loss)

    def problems(self, _everybody: Sequence[int]) -> Iterator[tuple[str, str]]:
        """No chain has short bursts and a great loss."""
        if self.enter > 1.0 + 1e-9:
            needed = math.ceil(self.loss / (1.0 - self.loss) - 1e-9)
            yield (
                "mean_ticks",
                f"bursts so short cannot make up a mean loss of {self.loss:g}; make it {needed} "
                "or more",
            )

    def idle(self, _slack_s: float) -> str:
        """Why it loses nothing."""
        return never(self.loss)

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Drop what is sent while its directed link is bad."""
        chains: dict[tuple[int, int], _Chain] = {}

        def good(link_message: LinkMessage, _: Effect) -> bool:
            link = link_message.src, link_message.dst
            tick = link_message.t_ns // tick_ns
            chain = chains.get(link)
            if chain is None or tick < chain.first:
                chain = chains[link] = _Chain()
            while chain.end <= tick:
                chain.add(self._next(chain.bad, draws.uniform("burst", *link, chain.end)))
            return not chain.bad[tick - chain.first]

        return good

    def passes(self, _link: LinkMessage) -> float | None:
        """1 - loss, the stationary value; none where p = L r / (1 - L) > 1: no chain is such."""
        return 1.0 - self.loss if self.enter <= 1.0 else None

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """Short ones and long ones."""
        return {"loss": dice.choice((0.2, 0.6)), "mean_ticks": dice.choice((3, 15))}

    def _next(self, chain: bytearray, uniform: float) -> bool:
        """Whether a link is bad in the tick after those of `chain`."""
        if not chain:
            return uniform < self.loss  # the chain starts in its stationary state
        return uniform >= self.leave if chain[-1] else uniform < self.enter
