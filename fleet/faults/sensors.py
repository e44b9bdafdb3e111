"""Rules about sensors: what a UAV takes its own state to be."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from fleet.faults.draws import Draws
from fleet.faults.rules import NodeRule, Rule, not_overridden
from fleet.model.vehicle.flight import State

Sense = Callable[[State, int], State | None]
"""What is sensed of a state at a time in ns; None: nothing is."""


class SensorRule(NodeRule, frozen=True, kw_only=True):
    """A rule that makes wrong what some UAVs sense of themselves."""

    of_uavs = True

    @classmethod
    def unsaid(cls) -> Iterator[str]:
        """Names of what a kind has to say of itself, and this one does not."""
        yield from super().unsaid()
        yield from not_overridden(cls, SensorRule, ("sensing",))

    @property
    def remembers(self) -> bool:
        """Whether what is sensed depends on when it was sensed before.

        In realtime no log tells that.
        """
        return False

    def sensing(self, draws: Draws, uav: int) -> Sense:
        """What it makes of one state after another, with the memory that this takes."""
        raise NotImplementedError


class Sensors:
    """What one UAV senses of its own state, under one plan; pure but for what rules remember."""

    def __init__(self, plan: Sequence[Rule], seed: int, uav: int) -> None:
        self._seed = seed
        self._uav = uav
        self._senses: dict[int, Sense] = {}
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on, of the same rules and further ones."""
        self._rules: list[tuple[SensorRule, Sense]] = []
        for n, rule in enumerate(plan):
            if isinstance(rule, SensorRule) and rule.hits(self._uav):
                if n not in self._senses:
                    self._senses[n] = rule.sensing(rule.draws(self._seed, n), self._uav)
                self._rules.append((rule, self._senses[n]))

    @property
    def clean(self) -> bool:
        """Whether it always senses the truth."""
        return not self._rules

    def sense(self, state: State, now_ns: int) -> State | None:
        """The state that it takes for its own; None: it does not know where it is."""
        sensed: State | None = state
        for rule, sense in self._rules:
            if rule.during(now_ns) and sensed is not None:
                sensed = sense(sensed, now_ns)
        return sensed
