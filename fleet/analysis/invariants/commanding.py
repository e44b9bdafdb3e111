"""Commands as they are sent: by who computes at that moment, and again only while that serves."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Sequence

from fleet.analysis.invariants.index import BELIEVED_FATES, Index
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.analysis.invariants.views import HeardElection, View
from fleet.model.units import to_ns
from fleet.protocol.messages import Ack, Command

LASTING = frozenset({"unknown_term", "no_mandate"})
"""Refusals after which a command may be accepted yet."""

CommandKey = tuple[int, int, int]


def mandated(index: Index, views: Sequence[View]) -> Examination:
    """A UAV commands, also again, only in the newest term that it has heard, as its computing UAV.

    Its mandate is in force by its own clock, and the command has not expired.
    """
    examination = Examination()
    by_issuer = {view.uav: view for view in views}
    for command in index.commands:
        view = by_issuer.get(command.id)
        if view is None or command.t_ns > index.settled_ns:
            continue
        examination.examined += 1
        told = _told(index, view, command)
        local_ns = index.local_ns(command.id, command.t_ns)
        what = (
            "" if any(_covers(t, command, local_ns) for t in told) else "without a mandate in force"
        )
        if not what and local_ns > command.expiry_ns:
            what = "after its expiry"
        if what:
            shown = [witness(t.election, "term", "computing", until_ns=t.until_ns) for t in told]
            examination.blame(f"UAV {command.id} sends a command {what}", *shown, _sent(command))
    return examination


def repeated_in_need(index: Index) -> Examination:
    """A command is sent again no sooner than set, and not once an answer to it has been heard.

    Acceptance is an answer, and so is a refusal that no repetition could mend.
    """
    examination = Examination()
    answered = _answered(index)
    again_ns = to_ns(index.scenario.commands.retransmit_s)
    last: dict[CommandKey, Command] = {}
    for command in index.commands:
        identity = (command.id, command.term, command.number)
        before = last.get(identity)
        last[identity] = command
        if before is None:
            continue
        examination.examined += 1
        answer_ns, ack = answered.get(identity, (command.t_ns, None))
        if ack is not None and answer_ns <= command.t_ns:
            what = f"command {command.number} is sent again after it was answered"
            shown = witness(ack, "term", "number", "accepted", "reason", heard_ns=answer_ns)
            examination.blame(what, shown, _sent(command))
        passed_ns = index.local_ns(command.id, command.t_ns) - index.local_ns(
            command.id, before.t_ns
        )
        if passed_ns < again_ns:
            examination.blame(
                f"command {command.number} is sent again too soon", _sent(before), _sent(command)
            )
    return examination


def _told(index: Index, view: View, command: Command) -> list[HeardElection]:
    """What the issuer may have gone by: the newest mandate heard since it began, or the one before.

    For an election of its own may come before or after a command of the same step, and in realtime
    what came during a step is taken in by the next.
    """
    begun_ns, _ = index.absences.incarnation_of(view.uav, command.t_ns)
    heard = [t for t in view.mandates if begun_ns <= t.at_ns]
    last = bisect_right(heard, command.t_ns, key=lambda t: t.at_ns) - 1
    since_ns = command.t_ns - (index.tick_ns if index.run.realtime else 0)
    first = last
    while first > 0 and heard[first].at_ns >= since_ns:
        first -= 1
    return heard[max(0, first) : last + 1]


def _covers(told: HeardElection, command: Command, local_ns: int) -> bool:
    election = told.election
    of_it = (election.term, election.computing) == (command.term, command.id)
    return of_it and told.from_ns <= local_ns <= told.until_ns


def _answered(index: Index) -> dict[CommandKey, tuple[int, Ack]]:
    """Of each command, the step in which its issuer first heard an answer that ends repetition."""
    first: dict[CommandKey, tuple[int, Ack]] = {}
    targets: defaultdict[CommandKey, set[int]] = defaultdict(set)
    for command in index.commands:
        targets[command.id, command.term, command.number].add(command.target)
    for node, step, receipt in index.receipts():
        ack = receipt.message
        if not isinstance(ack, Ack) or receipt.fate not in BELIEVED_FATES:
            continue
        identity = (node, ack.term, ack.number)
        if ack.id in targets[identity] and (ack.accepted or ack.reason not in LASTING):
            first.setdefault(identity, (step.t_ns, ack))
    return first


def _sent(command: Command) -> Witness:
    return witness(command, "term", "number", "target", "expiry_ns")
