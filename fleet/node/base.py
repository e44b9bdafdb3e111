"""What a UAV and the coordinator share as nodes: the clock they go by, what is due, their numbers.

Simulated time moves vehicles and marks messages. Whatever a node decides by time it decides by its
own clock, which a fault may have put wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from fleet.config.scenario import Scenario
from fleet.faults.clock import LocalClock
from fleet.faults.rules import Rule
from fleet.model.conflict.contact import INCARNATION
from fleet.model.election import Mandate
from fleet.model.units import to_ns
from fleet.node.runner import RestartState
from fleet.protocol.messages import Election, Message, PersistentState
from fleet.protocol.topics import topics_for


class BaseNode:
    """The part of a node that does not depend on what it is; `step` is left to it."""

    def __init__(self, number: int, scenario: Scenario, restart: RestartState | None) -> None:
        """`restart` is what a process that is started again finds; None at the first start."""
        self.id = number
        self.hears = topics_for(number)
        self.implausible: list[tuple[int, int]] = []
        memory = restart.memory if restart else None
        self._memory = memory or PersistentState(number, 0, 0, 0, 0, 0, 0)
        self._incarnation = restart.incarnation if restart else 0
        self._last_ns = restart.t_ns if restart else -1
        self._update_ns = to_ns(scenario.coordination.update_s)
        self._clock = LocalClock(scenario.fault, number)
        self._sent: Counter[str] = Counter()

    def replan(self, plan: Sequence[Rule]) -> None:
        """Suffer from another fault plan from now on."""
        self._clock.replan(plan)

    def _local(self, now_ns: int) -> int:
        """What its own clock shows."""
        return max(0, now_ns + self._clock.shift_ns(now_ns))

    def _due(self, now_ns: int, period_ns: int) -> bool:
        """Whether a multiple of the period has come since the last step."""
        return now_ns // period_ns > self._last_ns // period_ns

    def _next(self, cls: type[Message]) -> int:
        """The sequence number of its next message of a class."""
        self._sent[cls.kind] += 1
        return self._incarnation * INCARNATION + self._sent[cls.kind] - 1

    def _election(self, mandate: Mandate, now_ns: int) -> Election:
        """The announcement of a mandate."""
        return Election(
            self.id,
            self._next(Election),
            now_ns,
            mandate.term,
            mandate.members[0],
            mandate.members,
            mandate.computing,
            mandate.valid_until_ns,
        )

    def _remember(
        self, now_ns: int, highest_term: int, mandate_term: int, applied: tuple[int, int]
    ) -> list[Message]:
        """What must outlive this process, if it has changed; `applied` is term and number."""
        old, new = self._memory, (highest_term, mandate_term, *applied)
        if new == (old.highest_term, old.mandate_term, old.applied_term, old.applied_number):
            return []
        self._memory = PersistentState(self.id, self._next(PersistentState), now_ns, *new)
        return [self._memory]
