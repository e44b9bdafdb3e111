"""Flight: a UAV flies the manoeuvre that it obeys, from its start until it lapses, and no other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.analysis.invariants.views import Answered, View
from fleet.model.conflict.contact import INCARNATION
from fleet.model.words import UNMANNED, Manoeuvre
from fleet.protocol.messages import Truth

NONE = (0, 0, 0)


def flown_as_commanded(index: Index, views: Sequence[View]) -> Examination:
    """The command in force by each true state is the one that must be, or none where none must.

    In lockstep: there it is known to the nanosecond what was in force.
    """
    examination = Examination()
    if index.run.realtime:
        return examination
    for view in views:
        for truth, due in _moments(index, view):
            examination.examined += 1
            told = (truth.command_term, truth.command_issuer, truth.command_number)
            wanted = (due.command.term, due.command.id, due.command.number) if due else NONE
            speed_mps = (
                due.command.speed_mps if due and due.command.manoeuvre == Manoeuvre.SPEED else None
            )
            if told != wanted:
                what = f"UAV {view.uav} flies {_name(told)}, and should fly {_name(wanted)}"
                examination.blame(what, *_obeyed(due), witness(truth, "mode", "command_number"))
            elif truth.commanded_speed_mps != speed_mps:
                what = f"UAV {view.uav} does not fly at the speed of {_name(wanted)}"
                told_mps = witness(truth, "mode", "command_number", "commanded_speed_mps")
                examination.blame(what, *_obeyed(due), told_mps)
    return examination


def _moments(index: Index, view: View) -> Iterator[tuple[Truth, Answered | None]]:
    """Each true state of a UAV that flew itself, and the command that is then in force."""
    restarts = [again_ns for _, again_ns in index.absences.downs[view.uav] if again_ns is not None]
    coming = list(reversed(view.obeyed))
    incarnation, waiting, active = 0, None, None
    for truth in index.truths[view.uav]:
        if truth.mode in UNMANNED:
            continue
        now = sum(again_ns <= truth.t_ns for again_ns in restarts)
        if now != incarnation:
            incarnation, waiting, active = now, None, None
        while coming and coming[-1].ack.t_ns <= truth.t_ns:
            obeyed = coming.pop()
            if obeyed.ack.seq // INCARNATION == incarnation:
                waiting, active = _at(obeyed.ack.t_ns, waiting, active)
                waiting = obeyed
        waiting, active = _at(truth.t_ns, waiting, active)
        yield truth, active


def _at(
    now_ns: int, waiting: Answered | None, active: Answered | None
) -> tuple[Answered | None, Answered | None]:
    """What waits and what is in force at a time: the start of one ends the other."""
    if waiting and waiting.ack.actuate_ns <= now_ns:
        active = waiting if waiting.command.manoeuvre != Manoeuvre.RESUME else None
        waiting = None
    if active and _end_ns(active) <= now_ns:
        active = None
    return waiting, active


def _end_ns(obeyed: Answered) -> int:
    """When a manoeuvre lapses, which its UAV reads off its own clock as it was when it obeyed."""
    return obeyed.command.manoeuvre_end_ns - (obeyed.local_ns - obeyed.ack.t_ns)


def _name(command: tuple[int, int, int]) -> str:
    term, issuer, number = command
    return f"command {number} of UAV {issuer} in term {term}" if number else "by its own plan"


def _obeyed(due: Answered | None) -> list[Witness]:
    return [witness(due.ack, "term", "number", "actuate_ns")] if due else []
