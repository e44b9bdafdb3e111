"""Who computes: the lowest member that its elector has heard lately. And when UAVs elect at all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from fleet.analysis.invariants.index import BELIEVED, Index, Receipt
from fleet.analysis.invariants.verdict import Found, Witness, witness
from fleet.comms.messages import COORDINATOR, Adsb, Beat, Election


@dataclass
class Hearing:
    """What one elector has heard in its present life.

    Of each UAV and of the coordinator the last that was new to it; and the terms in which it was
    to compute.
    """

    life: int = -1
    last: dict[int, Receipt] = field(default_factory=dict)
    coordinator: Receipt | None = None
    led: set[int] = field(default_factory=set)
    seqs: dict[tuple[int, str], int] = field(default_factory=dict)

    def note(self, election: Election, elector: int) -> None:
        """Take in an election, heard or its own."""
        if elector in election.members and election.computing == elector:
            self.led.add(election.term)

    def take(self, receipt: Receipt) -> None:
        """Note what was believed, if it is newer than the last of that class from that issuer."""
        heard = receipt.message
        if receipt.fate not in BELIEVED or heard is None:
            return
        if heard.seq <= self.seqs.get((heard.id, heard.kind), -1):
            return
        self.seqs[heard.id, heard.kind] = heard.seq
        if isinstance(heard, Adsb):
            self.last[heard.id] = receipt
        elif isinstance(heard, Beat | Election) and heard.id == COORDINATOR:
            self.coordinator = receipt


def lowest_eligible(index: Index) -> Found:
    """Every election, repeated or not, names the lowest member not silent by its elector's clock.

    Heard is what its delivery reports say that it received and believed, and was new. A UAV always
    hears itself.
    """
    found = Found()
    for election, hearing in _elections(index):
        found.examined += 1
        _lowest(index, election, hearing, found)
    return found


def elected_in_need(index: Index) -> Found:
    """A UAV elects itself only where nobody else does that comes before it.

    It has not heard the coordinator within the limit (unless the scenario has none), and no member
    that it has heard within the limit said to be under a valid mandate of the coordinator or of a
    lower UAV (but for those by which the elector itself was to compute).
    """
    found = Found()
    for election, hearing in _elections(index):
        if election.id == COORDINATOR:
            continue
        found.examined += 1
        shown = witness(election, "term", "members")
        if hearing.coordinator and _lately(index, election, hearing.coordinator):
            what = f"UAV {election.id} elects although it hears the coordinator"
            found.blame(what, _heard(index, hearing.coordinator), shown)
        for member in sorted({*election.members} & {*hearing.last}):
            receipt = hearing.last[member]
            said = receipt.message
            assert isinstance(said, Adsb)
            if not _lately(index, election, receipt):
                continue
            term = said.mandate_term
            before = index.terms.elector_of(term) < election.id
            if said.mandate_valid and before and term not in hearing.led:
                what = f"UAV {election.id} elects although UAV {member} is under another"
                found.blame(what, _heard(index, receipt, mandate_term=term), shown)
    return found


def _elections(index: Index) -> Iterator[tuple[Election, Hearing]]:
    """Every election, and what its elector had heard by then."""
    for elector in sorted({e.id for e in index.elections} & set(index.nodes)):
        hearing = Hearing()
        for step in index.steps[elector]:
            if step.life != hearing.life:
                hearing = Hearing(step.life)
            for receipt in step.received:
                read = receipt.message
                if not isinstance(read, Election):
                    hearing.take(receipt)
                elif index.belongs(read):
                    hearing.note(read, elector)
                    hearing.take(receipt)
            for election in step.elected:
                yield election, hearing
                hearing.note(election, elector)


def _lately(index: Index, election: Election, receipt: Receipt) -> bool:
    """Whether something was heard within the limit of silence, by the clock of the elector."""
    elector = election.id
    age_ns = index.local_ns(elector, election.t_ns) - index.local_ns(elector, receipt.at_ns)
    return age_ns <= index.scenario.election_timing().silence_ns


def _lowest(index: Index, election: Election, hearing: Hearing, found: Found) -> None:
    elector = election.id
    heard = {
        uav: receipt
        for uav, receipt in hearing.last.items()
        if uav in election.members and _lately(index, election, receipt)
    }
    eligible = {*heard, elector} & {*election.members}
    lowest = min(eligible, default=None)
    if lowest == election.computing:
        return
    shown = [witness(election, "term", "members", "computing")]
    if lowest is not None and lowest != elector:
        shown.append(_heard(index, heard[lowest]))
    if election.computing not in eligible and election.computing in hearing.last:
        shown.append(_heard(index, hearing.last[election.computing]))
    what = f"the lowest eligible is {lowest or 'nobody'}, not UAV {election.computing}"
    found.blame(what, *shown)


def _heard(index: Index, receipt: Receipt, **more: int) -> Witness:
    """A message that the elector heard."""
    return witness(index.sent[receipt.key].message, "seq", heard_ns=receipt.at_ns, **more)
