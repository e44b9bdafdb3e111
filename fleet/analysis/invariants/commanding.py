"""Commands as they are sent: by who computes at that moment, and again only while that serves."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Sequence

from fleet.analysis.invariants.index import BELIEVED, Index
from fleet.analysis.invariants.verdict import Found, Witness, witness
from fleet.analysis.invariants.views import Told, View
from fleet.comms.messages import Ack, Cmd
from fleet.model.units import to_ns

LASTING = frozenset({"unknown_term", "no_mandate"})
"""Refusals after which a command may be accepted yet."""

Identity = tuple[int, int, int]


def mandated(index: Index, views: Sequence[View]) -> Found:
    """A UAV commands, also again, only in the newest term that it has heard, as its computing UAV.

    Its mandate is in force by its own clock, and the command has not expired.
    """
    found = Found()
    by_issuer = {view.uav: view for view in views}
    for cmd in index.cmds:
        view = by_issuer.get(cmd.id)
        if view is None or cmd.t_ns > index.settled_ns:
            continue
        found.examined += 1
        told = _told(index, view, cmd)
        local_ns = index.local_ns(cmd.id, cmd.t_ns)
        what = "" if any(_covers(t, cmd, local_ns) for t in told) else "without a mandate in force"
        if not what and local_ns > cmd.expiry_ns:
            what = "after its expiry"
        if what:
            shown = [witness(t.election, "term", "computing", until_ns=t.until_ns) for t in told]
            found.blame(f"UAV {cmd.id} sends a command {what}", *shown, _sent(cmd))
    return found


def repeated_in_need(index: Index) -> Found:
    """A command is sent again no sooner than set, and not once an answer to it has been heard.

    Acceptance is an answer, and so is a refusal that no repetition could mend.
    """
    found = Found()
    answered = _answered(index)
    again_ns = to_ns(index.scenario.commands.retransmit_s)
    last: dict[Identity, Cmd] = {}
    for cmd in index.cmds:
        identity = (cmd.id, cmd.term, cmd.number)
        before = last.get(identity)
        last[identity] = cmd
        if before is None:
            continue
        found.examined += 1
        answer_ns, ack = answered.get(identity, (cmd.t_ns, None))
        if ack is not None and answer_ns <= cmd.t_ns:
            what = f"command {cmd.number} is sent again after it was answered"
            shown = witness(ack, "term", "number", "accepted", "reason", heard_ns=answer_ns)
            found.blame(what, shown, _sent(cmd))
        passed_ns = index.local_ns(cmd.id, cmd.t_ns) - index.local_ns(cmd.id, before.t_ns)
        if passed_ns < again_ns:
            found.blame(f"command {cmd.number} is sent again too soon", _sent(before), _sent(cmd))
    return found


def _told(index: Index, view: View, cmd: Cmd) -> list[Told]:
    """What the issuer may have gone by: the newest mandate heard in this life, or the one before.

    For an election of its own may come before or after a command of the same step, and in realtime
    what came during a step is taken in by the next.
    """
    begun_ns, _ = index.life_of(view.uav, cmd.t_ns)
    heard = [t for t in view.mandates if begun_ns <= t.at_ns]
    last = bisect_right(heard, cmd.t_ns, key=lambda t: t.at_ns) - 1
    since_ns = cmd.t_ns - (index.tick_ns if index.history.realtime else 0)
    first = last
    while first > 0 and heard[first].at_ns >= since_ns:
        first -= 1
    return heard[max(0, first) : last + 1]


def _covers(told: Told, cmd: Cmd, local_ns: int) -> bool:
    election = told.election
    of_it = (election.term, election.computing) == (cmd.term, cmd.id)
    return of_it and told.from_ns <= local_ns <= told.until_ns


def _answered(index: Index) -> dict[Identity, tuple[int, Ack]]:
    """Of each command, the step in which its issuer first heard an answer that ends repetition."""
    first: dict[Identity, tuple[int, Ack]] = {}
    targets: defaultdict[Identity, set[int]] = defaultdict(set)
    for cmd in index.cmds:
        targets[cmd.id, cmd.term, cmd.number].add(cmd.target)
    for node, step, receipt in index.receipts():
        ack = receipt.message
        if not isinstance(ack, Ack) or receipt.fate not in BELIEVED:
            continue
        identity = (node, ack.term, ack.number)
        if ack.id in targets[identity] and (ack.accepted or ack.reason not in LASTING):
            first.setdefault(identity, (step.t_ns, ack))
    return first


def _sent(cmd: Cmd) -> Witness:
    return witness(cmd, "term", "number", "target", "expiry_ns")
