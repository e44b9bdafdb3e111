"""What a fault plan does to one message on one link: when it arrives, how often, in what state."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, Effect, LinkRule
from fleet.faults.rules import Rule
from fleet.model.units import to_ns


class Delivery(Struct, frozen=True):
    """One delivery: how much later than sent, and which bits are flipped (places in [0, 1))."""

    delay_ns: int
    flips: tuple[float, ...] = ()


class Fate(Struct, frozen=True):
    """Every delivery of a message; none, and the kind of the rule that dropped it."""

    deliveries: tuple[Delivery, ...]
    dropped_by: str = ""


class Channel:
    """All links into one receiver, under one plan; pure but for what bursts and queues remember."""

    def __init__(self, plan: Sequence[Rule], seed: int, tick_ns: int) -> None:
        self._seed = seed
        self._tick_ns = tick_ns
        self._acts: dict[int, Act] = {}
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on: the same rules, some of them ending earlier, and more.

        A rule is known by its place in the plan, so what it remembers is kept.
        """
        self._rules: list[tuple[LinkRule, Act]] = []
        for n, rule in enumerate(plan):
            if isinstance(rule, LinkRule):
                if n not in self._acts:
                    self._acts[n] = rule.act(Draws(self._seed, n), self._tick_ns)
                self._rules.append((rule, self._acts[n]))

    @property
    def clean(self) -> bool:
        """Whether no rule is about links: every message is delivered once, as it is."""
        return not self._rules

    @property
    def measures_distance(self) -> bool:
        """Whether a rule asks for the distance of sender and receiver."""
        return any(rule.by_distance for rule, _ in self._rules)

    def fate(self, link_message: LinkMessage) -> Fate:
        """What becomes of a message: rules in the order of the plan, the first drop wins."""
        effect = Effect()
        for rule, act in self._rules:
            if rule.concerns(link_message) and not act(link_message, effect):
                return Fate((), rule.name)
        first_ns = to_ns(effect.delay_s)
        copies = [Delivery(first_ns + to_ns(d), effect.flips) for d in effect.copies_s]
        return Fate((Delivery(first_ns, effect.flips), *copies))
