"""Process faults: who is up, held or down in each tick, as a function of the plan alone.

They are carried out as signals to real processes (SIGKILL, SIGSTOP, SIGCONT) where the bus has
such, and as the same absences on the in-memory bus.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Literal

from msgspec import Meta, Struct

from fleet.faults.rules import NodeRule, Rule
from fleet.model.units import to_ns

UP, HELD, DOWN = "up", "held", "down"


class Kill(NodeRule, frozen=True, tag="kill", kw_only=True):
    """The process is killed at `start_s`, and started again at `end_s`, if that is given.

    Its aircraft flies on straight and level (`then`), or vanishes.
    """

    then: Literal["straight", "vanish"] = "straight"


class Pause(NodeRule, frozen=True, tag="pause", kw_only=True):
    """The process is stopped over the window; its aircraft holds the last command meanwhile."""


class Slow(NodeRule, frozen=True, tag="slow", kw_only=True):
    """The process steps only in every `factor`-th tick; its aircraft holds the last command."""

    factor: Annotated[int, Meta(ge=2, le=1000)]


class LifecycleChange(Struct, frozen=True):
    """What happens to one process at the beginning of a tick."""

    node: int
    action: Literal["kill", "restart", "stop", "continue"]


class LifecycleSchedule:
    """Presence of all participants, tick by tick."""

    def __init__(self, nodes: Iterable[int], plan: Sequence[Rule], tick_ns: int) -> None:
        self._tick_ns = tick_ns
        self._rules: tuple[NodeRule, ...] = ()
        self._presence = dict.fromkeys(nodes, UP)
        self._incarnations = dict.fromkeys(self._presence, 0)
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on."""
        self._rules = tuple(r for r in plan if isinstance(r, Kill | Pause | Slow))

    def advance(self, tick: int) -> list[LifecycleChange]:
        """Enter a tick; returns what to do to whom, in order of number."""
        changes: list[LifecycleChange] = []
        if not self._rules and all(p == UP for p in self._presence.values()):
            return changes
        for node, before in self._presence.items():
            now = self._at(node, tick)
            if now == before:
                continue
            if now == DOWN:
                changes.append(LifecycleChange(node, "kill"))
            elif before == DOWN:
                self._incarnations[node] += 1
                changes.append(LifecycleChange(node, "restart"))
            if now == HELD:
                changes.append(LifecycleChange(node, "stop"))
            elif before == HELD and now == UP:
                changes.append(LifecycleChange(node, "continue"))
            self._presence[node] = now
        return changes

    @property
    def nodes(self) -> tuple[int, ...]:
        """All participants."""
        return tuple(self._presence)

    @property
    def held(self) -> tuple[int, ...]:
        """Who is stopped in this tick."""
        return tuple(n for n, p in self._presence.items() if p == HELD)

    @property
    def down(self) -> tuple[int, ...]:
        """Who is dead in this tick."""
        return tuple(n for n, p in self._presence.items() if p == DOWN)

    def incarnation(self, node: int) -> int:
        """How often a process has been started again."""
        return self._incarnations[node]

    def vanishes(self, node: int, tick: int) -> bool:
        """Whether the aircraft of a dead process has vanished with it."""
        now_ns = tick * self._tick_ns
        kills = [r for r in self._rules if isinstance(r, Kill)]
        return any(r.hits(node) and r.during(now_ns) and r.then == "vanish" for r in kills)

    def _at(self, node: int, tick: int) -> str:
        """Presence in a tick; everybody is there in the first, which tells where they are."""
        now_ns = tick * self._tick_ns
        found = UP
        if tick == 0:
            return found
        for rule in self._rules:
            if not (rule.hits(node) and rule.during(now_ns)):
                continue
            if isinstance(rule, Kill):
                return DOWN
            if isinstance(rule, Slow):
                first = -(-to_ns(rule.start_s) // self._tick_ns)
                if (tick - first) % rule.factor == 0:
                    continue
            found = HELD
        return found
