"""Groups: the coordinator puts together who belongs together, and nobody else."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from fleet.analysis.invariants.hearing import Hearing
from fleet.analysis.invariants.index import Index, Step
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.model.conflict.contact import INCARNATION
from fleet.model.types import COORDINATOR, Pair
from fleet.model.units import to_ns


def grouped(index: Index) -> Examination:
    """A group that the coordinator announces is what conflicts and commands connect.

    Those are the pairs of its own picture, and every UAV that flies a manoeuvre with whom it heard
    to command that, now or within the time for which a group is held. It is in one piece by them,
    and none of them leads out of it.
    """
    examination = Examination()
    for step, bonds in _updates(index):
        for election in step.elected:
            examination.examined += 1
            members = {*election.members}
            shown = witness(election, "term", "members")
            loose = members - _reached(min(members), bonds.possible())
            if loose:
                what = f"nothing binds {_names(loose)} to this group"
                examination.blame(what, *bonds.picture(), shown)
            for pair in sorted(bonds.certain()):
                if len(members.intersection(pair)) == 1:
                    what = f"UAV {pair[0]} and UAV {pair[1]} belong in one group"
                    examination.blame(what, *bonds.picture(), shown)
    return examination


class Bonds:
    """What binds UAVs together as the coordinator knows it, in one of its lives.

    Times are by its own clock. Of each pair it is kept when it was last bound for certain, and when
    it may have been: a silent UAV is no longer held to its command, and in realtime the log does
    not tell which step was an update.
    """

    def __init__(self, index: Index, incarnation: int) -> None:
        self.incarnation = incarnation
        self._index = index
        self._hearing = Hearing(index, COORDINATOR, incarnation)
        timing = index.scenario.coordination
        self._hold_ns, self._slack_ns = to_ns(timing.group_hold_s), 2 * to_ns(timing.update_s)
        self._update_ns = to_ns(timing.update_s)
        self._conflicts = [c for c in index.conflicts if c.seq // INCARNATION == incarnation]
        self._seen = 0
        self._now_ns = 0
        self._last_ns: int | None = None
        self._possible: dict[Pair, int] = {}
        self._certain: dict[Pair, int] = {}

    def step(self, step: Step) -> None:
        """Take in what it received, and what binds whom by then."""
        for receipt in step.received:
            self._hearing.take(receipt)
        conflicts = self._conflicts
        while self._seen < len(conflicts) and conflicts[self._seen].t_ns <= step.t_ns:
            self._seen += 1
        now_ns = self._now_ns = self._index.local_ns(COORDINATOR, step.t_ns)
        at_risk = conflicts[self._seen - 1].pairs if self._seen else ()
        commanded = dict(self._commanded(now_ns))
        self._possible.update(dict.fromkeys((*at_risk, *commanded), now_ns))
        last_ns, self._last_ns = self._last_ns, step.t_ns
        update = last_ns is not None and step.t_ns // self._update_ns > last_ns // self._update_ns
        if update and not self._index.run.realtime:
            sure = (pair for pair, certain in commanded.items() if certain)
            self._certain.update(dict.fromkeys((*at_risk, *sure), now_ns))
            self._certain = {pair: self._certain[pair] for pair in self.certain()}

    def possible(self) -> set[Pair]:
        """The pairs that may belong together now."""
        oldest_ns = self._now_ns - self._hold_ns - self._slack_ns
        return {pair for pair, t_ns in self._possible.items() if t_ns >= oldest_ns}

    def certain(self) -> set[Pair]:
        """The pairs that must."""
        oldest_ns = self._now_ns - self._hold_ns
        return {pair for pair, t_ns in self._certain.items() if t_ns >= oldest_ns}

    def picture(self) -> list[Witness]:
        """The picture of the conflicts that it has, if it has any."""
        return [witness(c, "pairs") for c in self._conflicts[max(0, self._seen - 1) : self._seen]]

    def _commanded(self, now_ns: int) -> Iterator[tuple[Pair, bool]]:
        """Who flies a manoeuvre, with its issuer, and whether neither of them is silent."""
        for uav in self._hearing.last:
            said = self._hearing.said(uav)
            issuer = said.command_issuer
            if said.manoeuvre and issuer not in (uav, COORDINATOR) and issuer in self._hearing.last:
                there = self._hearing.present(uav, now_ns) and self._hearing.present(issuer, now_ns)
                yield (min(uav, issuer), max(uav, issuer)), there


def _updates(index: Index) -> Iterator[tuple[Step, Bonds]]:
    """Every step of the coordinator, and what bound whom by then."""
    known = {(step.t_ns, step.incarnation): step for step in index.steps.get(COORDINATOR, ())}
    bonds = Bonds(index, 0)
    incarnations = sorted({incarnation for _, incarnation in known})
    for t_ns in index.stepped.get(COORDINATOR, ()):
        incarnation = next(
            (n for n in reversed(incarnations) if (t_ns, n) in known), bonds.incarnation
        )
        if incarnation != bonds.incarnation:
            bonds = Bonds(index, incarnation)
        step = known.get((t_ns, incarnation), Step(t_ns, incarnation, [], []))
        bonds.step(step)
        yield step, bonds


def _reached(start: int, pairs: Iterable[Pair]) -> set[int]:
    """Who is connected with one UAV by these pairs, itself included."""
    reached, edges = {start}, list(pairs)
    grown = True
    while grown:
        more = {n for pair in edges if reached.intersection(pair) for n in pair}
        grown = not more <= reached
        reached |= more
    return reached


def _names(uavs: Iterable[int]) -> str:
    return ", ".join(f"UAV {uav}" for uav in sorted(uavs))
