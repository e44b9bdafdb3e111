"""What a fault plan does to one message on one link: when it arrives, how often, in what state."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct

from fleet.faults.draws import LinkMessage, LinkMessageColumns
from fleet.faults.links import Act, ActTogether, Effect, Harm, LinkRule
from fleet.faults.rules import Rule
from fleet.model.types import Integers, Truths
from fleet.model.units import NS_PER_S, to_ns


class Delivery(Struct, frozen=True):
    """One delivery: how much later than sent, and which bits are flipped (places in [0, 1))."""

    delay_ns: int
    flips: tuple[float, ...] = ()


class Fate(Struct, frozen=True):
    """Every delivery of a message; none, and the kind of the rule that dropped it."""

    deliveries: tuple[Delivery, ...]
    dropped_by: str = ""


class JudgedMessages(Struct, frozen=True):
    """What becomes of n messages: by how much each is delayed, and what drops it ("": nothing)."""

    delay_ns: Integers
    dropped_by: tuple[str, ...]
    arrives: Truths


class Channel:
    """All links into one receiver, under one plan; pure but for what bursts and queues remember."""

    clean: bool
    """Whether no rule is about links: every message is delivered once, as it is."""

    reads_payloads: bool
    """Whether a rule asks for the payloads of messages, or for how long they are."""

    judges_together: bool
    """Whether messages of one time may be judged at once: each is delivered once, or not."""

    measures_distance: bool
    """Whether a rule asks for the distance of sender and receiver."""

    def __init__(self, plan: Sequence[Rule], seed: int, tick_ns: int) -> None:
        self._seed = seed
        self._tick_ns = tick_ns
        self._acts: dict[int, Act] = {}
        self._acts_together: dict[int, ActTogether] = {}
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on: the same rules, some of them ending earlier, and more.

        A rule is known by its place in the plan, so what it remembers is kept.
        """
        self._rules: list[tuple[LinkRule, Act]] = []
        self._together: list[tuple[LinkRule, ActTogether]] = []
        for n, rule in enumerate(plan):
            if isinstance(rule, LinkRule):
                if n not in self._acts:
                    draws = rule.draws(self._seed, n)
                    act = self._acts[n] = rule.act(draws, self._tick_ns)
                    self._acts_together[n] = rule.act_together(act, draws)
                self._rules.append((rule, self._acts[n]))
                self._together.append((rule, self._acts_together[n]))
        self._of_link: dict[tuple[int, int, str], tuple[int, list[tuple[LinkRule, Act]]]] = {}
        rules = [rule for rule, _ in self._rules]
        self._bounds_ns = sorted({bound_ns for rule in rules for bound_ns in rule.bounds_ns()})
        self.clean = not rules
        self.reads_payloads = any(r.by_size or Harm.ALTER in r.harms for r in rules)
        self.judges_together = judged_together(rules)
        self.measures_distance = any(r.by_distance for r in rules)

    def fate(self, link_message: LinkMessage) -> Fate:
        """What becomes of a message: rules in the order of the plan, the first drop wins."""
        effect = Effect()
        for rule, act in self._concerning(link_message):
            if not act(link_message, effect):
                return Fate((), rule.name)
        first_ns = to_ns(effect.delay_s)
        copies = [Delivery(first_ns + to_ns(d), effect.flips) for d in effect.copies_s]
        return Fate((Delivery(first_ns, effect.flips), *copies))

    def _concerning(self, link_message: LinkMessage) -> list[tuple[LinkRule, Act]]:
        """The rules about its class and link that are in force when it is sent.

        Kept for each link until another rule begins or ends: a plan that is changed again and again
        has hundreds that are over.
        """
        link, t_ns = (link_message.src, link_message.dst, link_message.kind), link_message.t_ns
        span = bisect_right(self._bounds_ns, t_ns)
        known = self._of_link.get(link)
        if known is None or known[0] != span:
            rules = [r for r in self._rules if r[0].concerns_link(*link) and r[0].during(t_ns)]
            known = self._of_link[link] = span, rules
        return known[1]

    def fates(self, sent: LinkMessageColumns) -> JudgedMessages:
        """What becomes of several, each as by `fate`; where they are judged together."""
        delay_s, arrives = np.zeros(len(sent.src)), np.ones(len(sent.src), dtype=np.bool_)
        dropped_by = [""] * len(sent.src)
        for rule, act in self._together:
            concerned = np.flatnonzero(arrives & rule.concerns_each(sent))
            if not len(concerned):
                continue
            added_s, passed = act(sent.part(concerned))
            delay_s[concerned] += added_s
            for n in concerned[~passed].tolist():
                dropped_by[n] = rule.name
            arrives[concerned] = passed
        return JudgedMessages(
            np.rint(delay_s * NS_PER_S).astype(np.int64), tuple(dropped_by), arrives
        )


def judged_together(plan: Iterable[Rule]) -> bool:
    """Whether no rule copies or alters messages, or goes by their order."""
    return not any(
        isinstance(rule, LinkRule) and (rule.by_order or rule.harms & (Harm.COPY | Harm.ALTER))
        for rule in plan
    )
