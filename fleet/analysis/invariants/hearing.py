"""What one elector had heard, and whom it could take to act; from its delivery reports alone."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.analysis.invariants.index import BELIEVED_FATES, Index, Receipt
from fleet.model.conflict.contact import Contact
from fleet.model.equipment import computes
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns
from fleet.protocol.messages import Election, Heartbeat, StateBroadcast


class Hearing:
    """One elector in one of its incarnations, all times by its own clock.

    Of each UAV and of the coordinator the last that was new to it; the terms in which it was to
    compute; and of UAVs that it has named, since when they have not answered, and when one was
    last passed over because it was not fit.
    """

    def __init__(self, index: Index, elector: int, incarnation: int = -1) -> None:
        self.incarnation = incarnation
        self.last: dict[int, Receipt] = {}
        self.coordinator: Receipt | None = None
        self.led: set[int] = set()
        self._index = index
        self._elector = elector
        self._timing = index.scenario.election_timing()
        self._rules = index.scenario.track_rules()
        self._contacts: dict[int, Contact] = {}
        self._heartbeats: Contact | None = None
        self._coordinator_ns = 0
        self._seqs: dict[tuple[int, str], int] = {}
        self._named_ns: dict[int, int] = {}
        self._unanswered_ns: dict[int, int] = {}
        self._passed_ns: dict[int, int] = {}

    def take(self, receipt: Receipt) -> None:
        """Note what was believed, if it is newer than the last of that class from that issuer."""
        heard = receipt.message
        if receipt.fate not in BELIEVED_FATES or heard is None:
            return
        if isinstance(heard, Election):
            if not self._index.belongs(heard):
                return
            self._note_led(heard)
        if heard.seq <= self._seqs.get((heard.id, heard.kind), -1):
            return
        self._seqs[heard.id, heard.kind] = heard.seq
        now_ns = self._index.local_ns(self._elector, receipt.at_ns)
        if isinstance(heard, StateBroadcast):
            self._take_broadcast(receipt, heard, now_ns)
        elif isinstance(heard, Heartbeat | Election) and heard.id == COORDINATOR:
            self.coordinator, self._coordinator_ns = receipt, now_ns
            if isinstance(heard, Heartbeat):
                self._take_heartbeat(heard, now_ns)

    def note(self, election: Election) -> None:
        """Take in an election that it announces."""
        self._note_led(election)
        now_ns = self._index.local_ns(self._elector, election.t_ns)
        for uav in election.members:
            if uav < election.computing and self.unfit(uav, now_ns):
                self._passed_ns[uav] = now_ns
        for uav in election.members:
            if not self._asked(uav, now_ns):
                self._unanswered_ns[uav] = now_ns
            self._named_ns[uav] = now_ns

    def said(self, uav: int) -> StateBroadcast:
        """The last broadcast of a UAV."""
        message = self.last[uav].message
        assert isinstance(message, StateBroadcast)
        return message

    def present(self, uav: int, now_ns: int) -> bool:
        """Whether a UAV has been heard within the limit of silence."""
        if uav == self._elector:
            return True
        contact = self._contacts.get(uav)
        if contact is None or contact.silent(now_ns):
            return False
        return now_ns - contact.last_ns <= self._rules.timeout_ns

    def hears_coordinator(self, now_ns: int) -> bool:
        """Whether the coordinator has been heard within the limit of silence."""
        limit_ns = self._heartbeats.limit_ns if self._heartbeats else self._timing.silence_ns
        return now_ns - self._coordinator_ns <= limit_ns

    def ranks(self, election: Election, now_ns: int) -> Sequence[list[int]]:
        """Members in order of preference: fit for some time, fit, at least there and equipped.

        A UAV as the elector does not ask for how long.
        """
        equipped = [m for m in election.members if not self._absent(m, now_ns)]
        fit = [m for m in equipped if not self.unfit(m, now_ns)]
        if self._elector != COORDINATOR:
            return fit, equipped
        steady_ns, passed_ns = self._timing.answer_ns, self._passed_ns
        lately = {m for m in passed_ns if now_ns - passed_ns[m] <= steady_ns}
        return [m for m in fit if m not in lately], fit, equipped

    def unfit(self, uav: int, now_ns: int) -> str:
        """Why a member cannot be taken to act; empty if it can."""
        absent = self._absent(uav, now_ns)
        if absent or uav == self._elector:
            return absent
        if not self.said(uav).hears:
            return "hears nobody of its group"
        since_ns = self._unanswered_ns.get(uav, now_ns)
        limit_ns = self._timing.answer_ns * self._contacts[uav].limit_ns // self._timing.silence_ns
        asked = self._elector == COORDINATOR and self._asked(uav, now_ns)
        if asked and now_ns - since_ns > limit_ns:
            return "has not answered the elections that name it"
        return ""

    def _absent(self, uav: int, now_ns: int) -> str:
        if not self.present(uav, now_ns):
            return "is silent"
        own = uav == self._elector
        equipment = self._index.equipped(uav) if own else self.said(uav).equipment
        return "" if computes(equipment) else "cannot compute"

    def _asked(self, uav: int, now_ns: int) -> bool:
        named_ns = self._named_ns.get(uav)
        return named_ns is not None and now_ns - named_ns <= self._timing.valid_ns

    def _note_led(self, election: Election) -> None:
        if self._elector in election.members and election.computing == self._elector:
            self.led.add(election.term)

    def _take_broadcast(self, receipt: Receipt, heard: StateBroadcast, now_ns: int) -> None:
        self.last[heard.id] = receipt
        contact = self._contacts.get(heard.id)
        if contact is None:
            rules = self._rules
            self._contacts[heard.id] = Contact(
                rules.silence_ns, rules.broadcast_ns, heard.seq, now_ns
            )
        else:
            contact.hear(heard.seq, now_ns)
        ours = self._index.terms.elector_of(heard.mandate_term) == self._elector
        if heard.mandate_valid and ours and self._asked(heard.id, now_ns):
            self._unanswered_ns[heard.id] = now_ns

    def _take_heartbeat(self, heartbeat: Heartbeat, now_ns: int) -> None:
        if self._heartbeats is None:
            heartbeat_ns = to_ns(self._index.scenario.coordination.heartbeat_s)
            self._heartbeats = Contact(self._timing.silence_ns, heartbeat_ns, heartbeat.seq, now_ns)
        else:
            self._heartbeats.hear(heartbeat.seq, now_ns)
