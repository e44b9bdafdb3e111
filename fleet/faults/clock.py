"""Rules about clocks: what a participant's own clock shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fleet.faults.rules import NodeRule, Rule, not_overridden


class ClockRule(NodeRule, frozen=True, kw_only=True):
    """A rule that makes the clock of some participants wrong; several add up."""

    @classmethod
    def unsaid(cls) -> Iterator[str]:
        """Names of what a kind has to say of itself, and this one does not."""
        yield from super().unsaid()
        yield from not_overridden(cls, ClockRule, ("shift_ns",))

    def shift_ns(self, now_ns: int) -> int:
        """By how much the clock is ahead while the rule is in force."""
        raise NotImplementedError


class LocalClock:
    """The clock of one participant, under one plan; it is `clean` if it is always right."""

    def __init__(self, plan: Sequence[Rule], node: int) -> None:
        self._node = node
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on."""
        self._rules = [r for r in plan if isinstance(r, ClockRule) and r.hits(self._node)]
        self.clean = not self._rules

    def shift_ns(self, now_ns: int) -> int:
        """Its reading minus true time."""
        if not self._rules:
            return 0
        return sum(rule.shift_ns(now_ns) for rule in self._rules if rule.during(now_ns))
