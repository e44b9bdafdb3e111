"""Terms: one computing UAV each, each its elector's, and rising."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from fleet.analysis.invariants.index import BELIEVED_FATES, Index
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.model.conflict.contact import INCARNATION
from fleet.model.types import COORDINATOR
from fleet.protocol.messages import Election, StateBroadcast

FIELDS = ("term", "members", "computing")
TOLD = ("highest_term", "mandate_term")


def one_leader(index: Index) -> Examination:
    """All elections of a term are alike; a term is its elector's; a UAV elects only itself."""
    examination = Examination(len(index.elections))
    first: dict[int, Election] = {}
    for election in index.elections:
        shown = witness(election, *FIELDS)
        same = first.setdefault(election.term, election)
        if _leader(same) != _leader(election):
            examination.blame(
                f"term {election.term} means two things", witness(same, *FIELDS), shown
            )
        owner = index.terms.elector_of(election.term)
        if owner != election.id or election.term < 1:
            examination.blame(f"term {election.term} is not its issuer's", shown)
        if election.id not in (COORDINATOR, election.computing):
            examination.blame(f"UAV {election.id} elects another", shown)
        if election.computing not in election.members:
            examination.blame(f"term {election.term} is led from outside its group", shown)
    return examination


def terms_rise(index: Index) -> Examination:
    """An elector begins each term above all its earlier ones, also after it was started again.

    A term that it has begun may be repeated in the same incarnation, but for no UAV that it has
    since named in a higher one. The terms that a UAV tells in its broadcasts never fall, and the
    highest is none below that of an election that it has heard.
    """
    examination = Examination(len(index.elections))
    for elector in sorted({e.id for e in index.elections}):
        _rising(sorted((e for e in index.elections if e.id == elector), key=_when), examination)
    told: defaultdict[int, list[StateBroadcast]] = defaultdict(list)
    for said in index.broadcasts.values():
        told[said.id].append(said)
    for uav in index.uavs:
        _told(index, uav, told[uav], examination)
    return examination


def _told(
    index: Index, uav: int, broadcasts: list[StateBroadcast], examination: Examination
) -> None:
    """Look at the terms that a UAV tells in its broadcasts, and at the elections it has heard."""
    heard = iter(_heard(index, uav))
    election = next(heard, None)
    highest: Election | None = None
    before: StateBroadcast | None = None
    for said in broadcasts:
        examination.examined += 1
        while election is not None and election[0] <= said.t_ns:
            if highest is None or election[1].term > highest.term:
                highest = election[1]
            election = next(heard, None)
        if highest and said.highest_term < highest.term:
            what = f"UAV {uav} tells no term as high as it has heard"
            examination.blame(what, witness(highest, *FIELDS), witness(said, "seq", *TOLD))
        if before and any(getattr(said, name) < getattr(before, name) for name in TOLD):
            what = f"UAV {uav} tells a lower term than before"
            examination.blame(what, witness(before, "seq", *TOLD), witness(said, "seq", *TOLD))
        before = said


def _heard(index: Index, uav: int) -> Iterator[tuple[int, Election]]:
    """The elections that a UAV has heard, and in which step."""
    for step in index.steps[uav]:
        for receipt in step.received:
            match receipt.message:
                case Election() as heard if receipt.fate in BELIEVED_FATES and index.belongs(heard):
                    yield step.t_ns, heard


def _rising(elections: list[Election], examination: Examination) -> None:
    """Look at the elections of one elector, in order."""
    highest: Election | None = None
    latest: dict[int, Election] = {}
    begun: set[int] = set()
    incarnation = 0
    for election in elections:
        if election.seq // INCARNATION != incarnation:
            incarnation = election.seq // INCARNATION
            begun.clear()
        if election.term not in begun and highest and election.term <= highest.term:
            examination.blame("a new term is not above those before it", *_both(highest, election))
        begun.add(election.term)
        if highest is None or election.term > highest.term:
            highest = election
        for member in election.members:
            before = latest.setdefault(member, election)
            if election.term < before.term:
                what = f"UAV {member} is named in a lower term than before"
                examination.blame(what, *_both(before, election))
            latest[member] = election


def _when(election: Election) -> tuple[int, int]:
    return election.t_ns, election.seq


def _leader(election: Election) -> tuple[int, tuple[int, ...], int]:
    return election.id, election.members, election.computing


def _both(before: Election, now: Election) -> tuple[Witness, Witness]:
    return witness(before, "seq", *FIELDS), witness(now, "seq", *FIELDS)
