"""The coordinator as a pure node: broadcasts in, elections out."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.model.conflict.groups import Grouping, commanded
from fleet.model.conflict.tracks import StateReport, TrafficPicture
from fleet.model.conflict.watch import ConflictWatch
from fleet.model.election import Answers, ComputingChoice, Elector, Terms
from fleet.model.equipment import computes
from fleet.model.types import COORDINATOR, Pair, Truths
from fleet.model.units import to_ns
from fleet.node.base import BaseNode
from fleet.node.broadcasts import BroadcastArrivals, Broadcasts
from fleet.node.node import InboxMessage, RestartState
from fleet.protocol.messages import (
    Conflict,
    Heartbeat,
    Message,
    StateBroadcast,
)


class Coordinator(BaseNode):
    """Keeps tracks, and an election in force for every conflict group."""

    def __init__(
        self,
        scenario: Scenario,
        restart: RestartState | None = None,
        tracks: TrafficPicture | None = None,
    ) -> None:
        """`restart` is what a process that is started again finds; None at the first start."""
        super().__init__(COORDINATOR, scenario, restart, tracks)
        self.position_ned_m = scenario.coordination.position_ned_m
        terms = Terms(u.id for u in uavs_of(scenario))
        timing = scenario.election_timing()
        self._terms = terms
        self._elector = Elector(COORDINATOR, terms, timing, self._memory.highest_term)
        self._answers = Answers(timing)
        self._choice = ComputingChoice(timing)
        self._grouping = Grouping(to_ns(scenario.coordination.group_hold_s))
        self._watch = ConflictWatch(scenario.outlook())
        self._heartbeat_ns = to_ns(scenario.coordination.heartbeat_s)
        self._known: tuple[tuple[Pair, ...], tuple[int, ...]] = ((), ())

    def step(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[Message]:
        """Take in broadcasts; at each update find the groups and elect."""
        self._take_one_by_one(inbox, now_ns)
        out: list[Message] = []
        if self._due(now_ns, self._update_ns):
            out += self._update(now_ns)
        if self._due(now_ns, self._heartbeat_ns):
            out.append(
                Heartbeat(self.id, self._next(Heartbeat), now_ns, self._elector.highest_term)
            )
        out += self._remember(now_ns, self._elector.highest_term, 0, (0, 0))
        self._last_ns = now_ns
        return out

    def answering(self, broadcasts: Broadcasts) -> Truths:
        """Those that are under a mandate of its own."""
        ours = self._terms.are_of(COORDINATOR, broadcasts.mandate_terms)
        return broadcasts.mandated & ours

    def took_broadcasts(self, arrivals: BroadcastArrivals) -> None:
        """The counter goes on above any term in use, also after a restart."""
        terms = arrivals.broadcasts.highest_terms[arrivals.places]
        self._elector.learn(int(terms.max(initial=0)))

    def take_broadcast(self, message: StateBroadcast, sent: StateBroadcast, local_ns: int) -> None:
        """Take in a broadcast."""
        self._elector.learn(message.highest_term)
        ours = self._terms.elector_of(message.mandate_term) == COORDINATOR
        self._hear(message, sent, local_ns, answering=message.mandate_valid and ours)

    def _update(self, now_ns: int) -> list[Message]:
        """Groups and elections, and the picture of the conflicts where it has changed."""
        local_ns = self._local(now_ns)
        reports = self.tracks.current(local_ns)
        pairs = self._watch.at_risk(reports, local_ns)
        groups = self._grouping.groups([*pairs, *commanded(reports)], local_ns)
        present = self.tracks.present(local_ns)
        equipped = {r.id for r in reports if r.id in present and computes(r.equipment)}
        fit = {r.id for r in reports if r.id in equipped and self._acts(r, local_ns)}
        chosen = {m: self._choice.leader(m, fit, equipped, local_ns) for m in groups}
        leaders = {members: leader for members, leader in chosen.items() if leader is not None}
        terms = {r.id: r.mandate_term for r in reports}
        elected = self._elector.elect(leaders, terms, self.tracks.share, local_ns)
        for mandate in elected:
            self._choice.announced(mandate, fit, local_ns)
            self._answers.ask(mandate.members, local_ns)
        alone = tuple(sorted(m for group in groups if group not in leaders for m in group))
        out: list[Message] = []
        if (pairs, alone) != self._known:
            self._known = (pairs, alone)
            times_s = self._watch.soon_s(pairs)
            out.append(Conflict(self.id, self._next(Conflict), now_ns, pairs, times_s, alone))
        return out + [self._election(mandate, now_ns) for mandate in elected]

    def _acts(self, report: StateReport, local_ns: int) -> bool:
        """Whether a UAV hears its group, and answers the elections that name it."""
        limit_ns = self.tracks.limit_ns(report.id)
        answered_ns = self.tracks.answered_ns(report.id)
        missing = self._answers.missing(report.id, answered_ns, limit_ns, local_ns)
        return report.hears and not missing
