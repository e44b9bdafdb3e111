"""What a UAV and the coordinator share as nodes: the clock they go by, what is due, their numbers.

Simulated time moves vehicles and marks messages. Whatever a node decides by time it decides by its
own clock, which a fault may have put wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.faults.channel import judged_together
from fleet.faults.clock import LocalClock
from fleet.faults.rules import Rule
from fleet.model.conflict.contact import INCARNATION
from fleet.model.conflict.track_table import TrackTable
from fleet.model.conflict.tracks import Tracks, TrafficPicture
from fleet.model.election import Mandate
from fleet.model.types import Integers, Truths
from fleet.model.units import to_ns
from fleet.node.broadcasts import BroadcastArrivals, Broadcasts
from fleet.node.node import InboxMessage, RestartState
from fleet.protocol.messages import Election, Message, PersistentState, StateBroadcast
from fleet.protocol.surveillance import report_of
from fleet.protocol.topics import topics_for

MANY = 12
"""From so many UAVs on, tracks are kept and taken in as columns: for fewer that is no faster."""


def track_table(scenario: Scenario, receivers: int) -> TrackTable | None:
    """A table of tracks for so many receivers, where that is faster than `Tracks`.

    Messages that faults copy or alter are taken in one by one.
    """
    uavs = [u.id for u in uavs_of(scenario)]
    if len(uavs) < MANY or not judged_together(scenario.fault):
        return None
    return TrackTable(receivers, uavs, scenario.track_rules(), report_of)


def new_tracks(scenario: Scenario) -> TrafficPicture:
    """What a node knows of the others at its start: nothing."""
    table = track_table(scenario, 1)
    return table.row(0) if table else Tracks(scenario.track_rules())


class BaseNode:
    """The part of a node that does not depend on what it is; `step` is left to it."""

    doing = "computing"
    takes_together = True

    def __init__(
        self,
        number: int,
        scenario: Scenario,
        restart: RestartState | None,
        tracks: TrafficPicture | None,
    ) -> None:
        """`restart` is what a process that is started again finds; None at the first start.

        `tracks` are where it keeps what it hears, if that is in a table with those of others.
        """
        self.id = number
        self.hears = topics_for(number)
        self.tracks = tracks or new_tracks(scenario)
        self.stopwatch: Callable[[], int] = int
        self.round_ns = 0
        self.implausible: list[tuple[int, int]] = []
        self._found_implausible: list[tuple[int, int]] = []
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

    def hearing_ns(self, delivered_ns: int, _now_ns: int) -> int:
        """What its clock shows when something is delivered."""
        return self._local(delivered_ns)

    def hearing_times_ns(self, delivered_ns: Integers, now_ns: int) -> Integers:
        """The same of several, shape (n,)."""
        times_ns = [self.hearing_ns(at_ns, now_ns) for at_ns in delivered_ns.tolist()]
        return np.array(times_ns, dtype=np.int64)

    def answering(self, broadcasts: Broadcasts) -> Truths:
        """Which broadcasts answer an election: all that say to be under a mandate."""
        return broadcasts.mandated

    def took_broadcasts(self, arrivals: BroadcastArrivals) -> None:
        """They have been taken in by its tracks."""

    def doubts(self, message: StateBroadcast) -> None:
        """Its tracks have found a broadcast implausible."""
        self._found_implausible.append((message.id, message.seq))

    def take_broadcast(self, message: StateBroadcast, sent: StateBroadcast, local_ns: int) -> None:
        """Take in one broadcast; `sent` is what it was before a fault altered it."""
        raise NotImplementedError

    def _hear(
        self, message: StateBroadcast, sent: StateBroadcast, local_ns: int, *, answering: bool
    ) -> None:
        if not self.tracks.hear(report_of(message), local_ns, answering=answering):
            self.doubts(sent)

    def _take_one_by_one(self, inbox: Sequence[InboxMessage], now_ns: int) -> None:
        """Begin a step with the broadcasts that did not come together with others.

        What was found implausible is told of all that came since the last step.
        """
        for item in inbox:
            message, sent = item.message, item.original
            if isinstance(message, StateBroadcast) and isinstance(sent, StateBroadcast):
                local_ns = self.hearing_ns(item.delivered_ns, now_ns)
                self.take_broadcast(message, sent, local_ns)
        self.implausible, self._found_implausible = self._found_implausible, []

    def _local(self, now_ns: int) -> int:
        """What its own clock shows."""
        clock = self._clock
        return max(0, now_ns if clock.clean else now_ns + clock.shift_ns(now_ns))

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
