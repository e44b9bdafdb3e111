"""Rules about processes: who is up, held or down in each tick, as a function of the plan alone.

They are carried out as signals to real processes (SIGKILL, SIGSTOP, SIGCONT) where the bus has
such, and as the same absences on the in-memory bus.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from enum import IntEnum
from typing import Literal

from msgspec import Struct

from fleet.faults.rules import NodeRule, Rule, not_overridden
from fleet.model.units import to_ns

UP, HELD, DOWN = "up", "held", "down"
_WORST = (UP, HELD, DOWN)


class Severity(IntEnum):
    """How much a rule takes from a participant, from the least to the most."""

    SOME_STEPS = 0
    STEPS = 1
    PROCESS = 2
    AIRCRAFT = 3


class ProcessRule(NodeRule, frozen=True, kw_only=True):
    """A rule that stops, slows or kills the processes of some participants.

    An aircraft whose process is held holds its last command; one without a process flies straight
    on and level, or is gone.
    """

    @classmethod
    def unsaid(cls) -> Iterator[str]:
        """Names of what a kind has to say of itself, and this one does not."""
        yield from super().unsaid()
        yield from not_overridden(cls, ProcessRule, ("severity",))

    @property
    def severity(self) -> Severity:
        """How much it takes while it is in force; of some steps `presence` says which."""
        raise NotImplementedError

    def presence(self, n: int) -> str:
        """Whether a process is up, held or down in the n-th tick of the rule, from 0."""
        return DOWN if self.severity >= Severity.PROCESS else HELD

    def outdoes(self, other: ProcessRule, apart: int) -> bool:
        """Whether while it is in force it makes no difference that another rule is.

        It begins `apart` ticks after the other one.
        """
        return self.severity > Severity.SOME_STEPS and self.severity >= other.severity


class LifecycleChange(Struct, frozen=True):
    """What happens to one process at the beginning of a tick."""

    node: int
    action: Literal["kill", "restart", "stop", "continue"]


class LifecycleSchedule:
    """Presence of all participants, tick by tick: who is `held` and who is `down` in this one."""

    def __init__(self, nodes: Iterable[int], plan: Sequence[Rule], tick_ns: int) -> None:
        self._tick_ns = tick_ns
        self._rules: tuple[ProcessRule, ...] = ()
        self._presence = dict.fromkeys(nodes, UP)
        self._incarnations = dict.fromkeys(self._presence, 0)
        self.held: tuple[int, ...] = ()
        self.down: tuple[int, ...] = ()
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on."""
        self._rules = tuple(r for r in plan if isinstance(r, ProcessRule))

    def advance(self, tick: int) -> list[LifecycleChange]:
        """Enter a tick; returns what to do to whom, in order of number."""
        changes: list[LifecycleChange] = []
        if not (self._rules or self.held or self.down):
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
        if changes:
            self.held, self.down = self._those(HELD), self._those(DOWN)
        return changes

    @property
    def nodes(self) -> tuple[int, ...]:
        """All participants."""
        return tuple(self._presence)

    def _those(self, presence: str) -> tuple[int, ...]:
        return tuple(n for n, p in self._presence.items() if p == presence)

    def incarnation(self, node: int) -> int:
        """How often a process has been started again."""
        return self._incarnations[node]

    def restarted(self, node: int) -> int:
        """Another process has come in the place of one, by nobody's plan; its incarnation."""
        self._incarnations[node] += 1
        return self._incarnations[node]

    def vanishes(self, node: int, tick: int) -> bool:
        """Whether the aircraft of a dead process has vanished with it."""
        now_ns = tick * self._tick_ns
        gone = [r for r in self._rules if r.severity is Severity.AIRCRAFT]
        return any(r.hits(node) and r.during(now_ns) for r in gone)

    def _at(self, node: int, tick: int) -> str:
        """Presence in a tick; everybody is there in the first, which tells where they are."""
        now_ns, found = tick * self._tick_ns, UP
        if tick == 0:
            return found
        for rule in self._rules:
            if rule.hits(node) and rule.during(now_ns):
                first = -(-to_ns(rule.start_s) // self._tick_ns)
                found = max(found, rule.presence(tick - first), key=_WORST.index)
        return found
