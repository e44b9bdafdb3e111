"""A UAV's part in elections: which mandate it is under, and electing itself without a coordinator.

A UAV elects itself when it has not heard the coordinator for longer than the silence limit, is the
lowest eligible ID of its own conflict group as far as it hears, and nobody in that group says to be
under a valid mandate of the coordinator's or of a lower UAV's.
"""

from __future__ import annotations

from fleet.agents.mandate_states import MandateState, mandate_state
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.model.conflict.contact import Contact
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.groups import Grouping, commanded
from fleet.model.conflict.tracks import StateReport, TrafficPicture
from fleet.model.election import Answers, Elector, Mandate, Terms, lowest_eligible
from fleet.model.equipment import computes
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns
from fleet.protocol.messages import Election, Heartbeat, PersistentState


class Voter:
    """Mandate, terms and local elections of one UAV. All times by its own clock."""

    def __init__(self, uav: Uav, scenario: Scenario, memory: PersistentState | None = None) -> None:
        self.answers = Answers(scenario.election_timing())
        self.mandate: Mandate | None = None
        self.minimum_term = memory.mandate_term if memory else 0
        self._own = own = uav.id
        self._computes = computes(uav.equipment)
        self._terms = Terms(u.id for u in uavs_of(scenario))
        timing = scenario.election_timing()
        self._elector = Elector(own, self._terms, timing, memory.highest_term if memory else 0)
        self._grouping = Grouping(to_ns(scenario.coordination.group_hold_s))
        self._outlook = scenario.outlook()
        self._silence_ns = timing.silence_ns
        self._valid_ns = timing.valid_ns
        self._always = scenario.coordination.electors == "local"
        self._led: set[int] = set()
        self._heartbeats: Contact | None = None
        self._heartbeat_ns = to_ns(scenario.coordination.heartbeat_s)
        self._coordinator_ns: int | None = None
        self._coordinator_seq: dict[str, int] = {}

    @property
    def highest_term(self) -> int:
        """Of all elections seen."""
        return self._elector.highest_term

    def state(self, now_ns: int) -> MandateState:
        """How the UAV stands to elections."""
        return mandate_state(self.mandate, self._own, now_ns)

    def valid(self, now_ns: int) -> bool:
        """Whether the mandate is in force."""
        return self.state(now_ns) in (MandateState.MEMBER, MandateState.COMPUTING)

    def on_heartbeat(self, heartbeat: Heartbeat, now_ns: int) -> None:
        """The coordinator is there."""
        if heartbeat.id != COORDINATOR:
            return
        self._elector.learn(heartbeat.highest_term)
        if not self._note_coordinator(heartbeat.kind, heartbeat.seq, now_ns):
            return
        if self._heartbeats is None:
            self._heartbeats = Contact(self._silence_ns, self._heartbeat_ns, heartbeat.seq, now_ns)
        else:
            self._heartbeats.hear(heartbeat.seq, now_ns)

    def on_election(self, election: Election, now_ns: int) -> bool:
        """Take in an election; True if it is the mandate now.

        One whose term is not its issuer's, or by which a UAV elects another, is ignored.
        """
        local = election.id != COORDINATOR
        if self._terms.elector_of(election.term) != election.id or election.term < 1:
            return False
        if local and election.computing != election.id:
            return False
        self._elector.learn(election.term)
        if not local:
            self._note_coordinator(election.kind, election.seq, now_ns)
        if self._own not in election.members or election.term < self.minimum_term:
            return False
        until_ns = election.valid_until_ns
        if self.mandate and self.mandate.term == election.term:
            until_ns = max(until_ns, self.mandate.valid_until_ns)
        until_ns = min(until_ns, now_ns + self._valid_ns)  # the elector's clock may be ahead
        if election.computing == self._own:
            self._led.add(election.term)
        self.answers.ask(election.members, now_ns)
        self.minimum_term = election.term
        self.mandate = Mandate(
            election.term, election.members, election.computing, until_ns, now_ns
        )
        return True

    def hears_coordinator(self, now_ns: int) -> bool:
        """Whether the coordinator has been heard within the limit, or not been missed for longer.

        From the first time that this is asked it has as long to make itself heard.
        """
        if self._coordinator_ns is None:
            self._coordinator_ns = now_ns
        limit_ns = self._heartbeats.limit_ns if self._heartbeats else self._silence_ns
        return now_ns - self._coordinator_ns <= limit_ns

    def stands(self, now_ns: int) -> bool:
        """Whether the UAV may elect itself; where it may not, its elections run out."""
        missed = not self.hears_coordinator(now_ns)
        if self._computes and (self._always or missed):
            return True
        self._elector.resign()
        return False

    def elect(self, own: StateReport, tracks: TrafficPicture, now_ns: int) -> Mandate | None:
        """The UAV's election of itself, if it stands and one is to be announced now."""
        reports = sorted([own, *tracks.current(now_ns)], key=lambda r: r.id)
        pairs = [*conflicts(reports, now_ns, self._outlook), *commanded(reports)]
        groups = self._grouping.groups(pairs, now_ns)
        group = next((g for g in groups if self._own in g), ())
        present = {*tracks.present(now_ns), self._own}
        equipped = {r.id for r in reports if r.id in present and computes(r.equipment)}
        fit = {r.id for r in reports if r.id in equipped and r.hears}
        lowest = lowest_eligible(group, fit, equipped)
        if lowest != self._own or any(self._yields_to(r) for r in reports if r.id in group):
            self._elector.resign()
            return None
        terms = {r.id: r.mandate_term for r in reports}
        elected = self._elector.elect({group: self._own}, terms, tracks.share, now_ns)
        return next(iter(elected), None)

    def _yields_to(self, member: StateReport) -> bool:
        """Whether a member is under another elector that comes first: leave the group to it."""
        if not member.mandate_valid or member.mandate_term in self._led:
            return False  # elected by another, but to compute: it may as well carry on
        return self._terms.elector_of(member.mandate_term) < self._own

    def _note_coordinator(self, kind: str, seq: int, now_ns: int) -> bool:
        """Whether it is a sign of life, which a replay is not."""
        if seq <= self._coordinator_seq.get(kind, -1):
            return False
        self._coordinator_seq[kind] = seq
        self._coordinator_ns = now_ns
        return True
