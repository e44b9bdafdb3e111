"""What each UAV had heard of elections when it obeyed or refused a command."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from fleet.analysis.invariants.index import BELIEVED_FATES, Index, Receipt
from fleet.protocol.messages import Ack, Command, Election


@dataclass(frozen=True, slots=True)
class HeardElection:
    """An election as a UAV heard it (or announced it itself), and when.

    By the UAV's own clock its mandate is in force from `from_ns`, when it was heard, to `until_ns`,
    going by all that was heard of that term until then, and no longer than any mandate can be.
    """

    at_ns: int
    election: Election
    from_ns: int
    until_ns: int


@dataclass(frozen=True, slots=True)
class Answered:
    """A command that was obeyed or refused, and what its target had heard and obeyed until then.

    `local_ns` is when it answered by its own clock. `newest` is the election of the highest term
    that names the target. Of the command's own term, `mandate` is the last one that names the
    target, and `foreign` the last one that does not. `last` is what it had obeyed last: term and
    number.
    """

    ack: Ack
    command: Command
    local_ns: int
    newest: HeardElection | None
    mandate: HeardElection | None
    foreign: HeardElection | None
    last: tuple[int, int]


@dataclass
class View:
    """One UAV's elections and commands, over all its lives."""

    uav: int
    valid_ns: int
    obeyed: list[Answered] = field(default_factory=list)
    refused: list[Answered] = field(default_factory=list)
    mandates: list[HeardElection] = field(default_factory=list)
    answers: int = 0
    unfounded: list[Ack] = field(default_factory=list)
    _newest: HeardElection | None = None
    _named: dict[int, HeardElection] = field(default_factory=dict)
    _foreign: dict[int, HeardElection] = field(default_factory=dict)

    def hear(self, election: Election, at_ns: int, local_ns: int) -> None:
        """Take in an election that belongs to its issuer."""
        term, until_ns = election.term, election.valid_until_ns
        if self.uav not in election.members:
            self._foreign[term] = HeardElection(at_ns, election, local_ns, until_ns)
            return
        before = self._named.get(term)
        until_ns = max(until_ns, before.until_ns if before else 0)
        told = HeardElection(at_ns, election, local_ns, min(until_ns, local_ns + self.valid_ns))
        self._named[term] = told
        if self._newest is None or term >= self._newest.election.term:
            self._newest = told
            self.mandates.append(told)

    def answer(self, ack: Ack, command: Command, local_ns: int) -> None:
        """Take in how it answered a command."""
        named, foreign = self._named.get(command.term), self._foreign.get(command.term)
        last = (
            (self.obeyed[-1].command.term, self.obeyed[-1].command.number)
            if self.obeyed
            else (0, 0)
        )
        answered = Answered(ack, command, local_ns, self._newest, named, foreign, last)
        (self.obeyed if ack.accepted else self.refused).append(answered)


def views_of(index: Index) -> list[View]:
    """Follow every UAV through its delivery reports."""
    return [_view(index, uav) for uav in index.uavs]


def _view(index: Index, uav: int) -> View:
    view = View(uav, index.scenario.election_timing().valid_ns)
    answers: defaultdict[tuple[int, int, int], list[Ack]] = defaultdict(list)
    for ack in reversed(index.acks):
        if ack.id == uav:
            view.answers += 1
            answers[ack.target, ack.term, ack.number].append(ack)
    for step in index.steps[uav]:
        for receipt in step.received:
            if receipt.fate in BELIEVED_FATES:
                _take(index, view, receipt, answers)
        for election in step.elected:
            view.hear(election, step.t_ns, index.local_ns(uav, step.t_ns))
    left = [a for acks in answers.values() for a in acks if a.t_ns <= index.settled_ns]
    view.unfounded = sorted(left, key=lambda a: a.seq)
    return view


def _take(
    index: Index,
    view: View,
    receipt: Receipt,
    answers: dict[tuple[int, int, int], list[Ack]],
) -> None:
    """Take in an election, or a command together with its answer."""
    match receipt.message:
        case Election() as election if index.belongs(election):
            view.hear(election, receipt.at_ns, index.local_ns(view.uav, receipt.at_ns))
        case Command() as command:
            waiting = answers.get((command.id, command.term, command.number))
            if waiting:
                ack = waiting.pop()
                view.answer(ack, command, index.local_ns(view.uav, ack.t_ns))


def all_obeyed(views: Sequence[View]) -> list[Answered]:
    """All commands that were accepted, in order of UAV and time."""
    return [o for view in views for o in view.obeyed]
