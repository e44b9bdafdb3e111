"""Who computes: the lowest member that acts as far as its elector hears. And when UAVs elect."""

from __future__ import annotations

from collections.abc import Iterator

from fleet.analysis.invariants.hearing import Hearing
from fleet.analysis.invariants.index import Index, Receipt
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.model.equipment import computes
from fleet.model.types import COORDINATOR
from fleet.protocol.messages import Election, StateBroadcast


def computing_is_lowest(index: Index) -> Examination:
    """Every election, repeated or not, names the lowest member that its elector can take to act.

    Heard is what its delivery reports say that it received and believed, and was new. A UAV always
    hears itself.
    """
    examination = Examination()
    for election, hearing in _elections(index):
        examination.examined += 1
        now_ns = index.local_ns(election.id, election.t_ns)
        ranks = hearing.ranks(election, now_ns)
        eligible = next((rank for rank in ranks if rank), [])
        lowest = min(eligible, default=None)
        if lowest == election.computing:
            continue
        shown = [witness(election, "term", "members", "computing")]
        what = f"the lowest eligible is {lowest or 'nobody'}, not UAV {election.computing}"
        why = hearing.unfit(election.computing, now_ns)
        wrong = (lowest, election.computing) if why else (lowest,)
        heard = [u for u in wrong if u in hearing.last]
        shown += [_heard(index, hearing.last[u], **_fitness(hearing.said(u))) for u in heard]
        examination.blame(f"{what}, which {why}" if why else what, *shown)
    return examination


def elected_in_need(index: Index) -> Examination:
    """A UAV elects itself only where nobody else does that comes before it.

    It has not heard the coordinator within the limit (unless the scenario has none), and no member
    that it has heard within the limit said to be under a valid mandate of the coordinator or of a
    lower UAV (but for those by which the elector itself was to compute).
    """
    examination = Examination()
    for election, hearing in _elections(index):
        if election.id == COORDINATOR:
            continue
        examination.examined += 1
        now_ns = index.local_ns(election.id, election.t_ns)
        shown = witness(election, "term", "members")
        if hearing.coordinator and hearing.hears_coordinator(now_ns):
            what = f"UAV {election.id} elects although it hears the coordinator"
            examination.blame(what, _heard(index, hearing.coordinator), shown)
        for member in sorted({*election.members} & {*hearing.last}):
            if not hearing.present(member, now_ns):
                continue
            said = hearing.said(member)
            term = said.mandate_term
            before = index.terms.elector_of(term) < election.id
            if said.mandate_valid and before and term not in hearing.led:
                what = f"UAV {election.id} elects although UAV {member} is under another"
                examination.blame(
                    what, _heard(index, hearing.last[member], mandate_term=term), shown
                )
    return examination


def _elections(index: Index) -> Iterator[tuple[Election, Hearing]]:
    """Every election, and what its elector had heard by then."""
    for elector in sorted({e.id for e in index.elections} & set(index.nodes)):
        hearing = Hearing(index, elector)
        for step in index.steps[elector]:
            if step.incarnation != hearing.incarnation:
                hearing = Hearing(index, elector, step.incarnation)
            for receipt in step.received:
                hearing.take(receipt)
            for election in step.elected:
                yield election, hearing
                hearing.note(election)


def _fitness(said: StateBroadcast) -> dict[str, object]:
    """What a broadcast says of whether its sender can lead, where that is not the usual."""
    fields: dict[str, object] = {}
    if said.mandate_term and not said.mandate_valid:
        fields |= {"mandate_valid": False}
    if not said.hears:
        fields |= {"hears": False}
    if not computes(said.equipment):
        fields |= {"equipment": said.equipment}
    return fields


def _heard(index: Index, receipt: Receipt, **more: object) -> Witness:
    """A message that the elector heard."""
    return witness(index.sent[receipt.key].message, "seq", heard_ns=receipt.at_ns, **more)
