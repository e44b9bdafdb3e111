"""Commands: what was obeyed, and what was sent again."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.analysis.invariants.views import Answered, HeardElection, View, all_obeyed
from fleet.protocol.messages import Ack, Command

IDENTITY = ("term", "number")


def stale_terms(views: Sequence[View]) -> Examination:
    """Nothing is obeyed in a term below one in which the UAV was named, or in which it obeyed."""
    examination = Examination()
    for view in views:
        before: Answered | None = None
        for obeyed in view.obeyed:
            examination.examined += 1
            newest, term = obeyed.newest, obeyed.command.term
            if newest and newest.election.term > term:
                what = f"UAV {view.uav} obeys term {term}, but has heard of a higher one"
                examination.blame(what, _told(newest), *_obeyed(obeyed))
            if before and before.command.term > term:
                what = f"UAV {view.uav} obeys term {term} after term {before.command.term}"
                examination.blame(what, _ack(before.ack), *_obeyed(obeyed))
            before = obeyed
    return examination


def issuer(views: Sequence[View]) -> Examination:
    """The issuer of what is obeyed is the computing UAV of its term."""
    examination = Examination()
    for obeyed in all_obeyed(views):
        examination.examined += 1
        told = obeyed.mandate or obeyed.foreign
        if told and told.election.computing != obeyed.command.id:
            what = f"UAV {obeyed.command.id} does not compute in term {obeyed.command.term}"
            examination.blame(what, _told(told), *_obeyed(obeyed))
    return examination


def own_group(views: Sequence[View]) -> Examination:
    """The target of what is obeyed is in the group of its term."""
    examination = Examination()
    for obeyed in all_obeyed(views):
        examination.examined += 1
        if obeyed.mandate is None:
            uav, term = obeyed.ack.id, obeyed.command.term
            what = f"no election of term {term} that UAV {uav} has heard names it"
            foreign = [_told(obeyed.foreign)] if obeyed.foreign else []
            examination.blame(what, *foreign, *_obeyed(obeyed))
    return examination


def in_time(views: Sequence[View]) -> Examination:
    """Nothing is obeyed after its expiry or out of its mandate's time, by the clock of the UAV."""
    examination = Examination()
    for obeyed in all_obeyed(views):
        examination.examined += 1
        ack, command = obeyed.ack, obeyed.command
        local_ns = obeyed.local_ns
        if local_ns > command.expiry_ns:
            what = f"UAV {ack.id} obeys a command that has expired"
            examination.blame(what, *_obeyed(obeyed, own_clock_ns=local_ns))
        if obeyed.mandate and local_ns < obeyed.mandate.from_ns:
            what = f"UAV {ack.id} obeys in term {command.term} before it heard of it"
            told = _told(obeyed.mandate, from_ns=obeyed.mandate.from_ns)
            examination.blame(what, told, *_obeyed(obeyed, own_clock_ns=local_ns))
        if obeyed.mandate and local_ns > obeyed.mandate.until_ns:
            what = f"UAV {ack.id} obeys in term {command.term}, which has run out"
            told = _told(obeyed.mandate, until_ns=obeyed.mandate.until_ns)
            examination.blame(what, told, *_obeyed(obeyed, own_clock_ns=local_ns))
    return examination


def once(views: Sequence[View]) -> Examination:
    """Nothing is obeyed twice, and of one term nothing that was numbered before the last."""
    examination = Examination()
    for view in views:
        done: dict[tuple[int, int, int], Ack] = {}
        last: dict[int, Ack] = {}
        for obeyed in view.obeyed:
            examination.examined += 1
            ack = obeyed.ack
            first = done.setdefault((ack.target, ack.term, ack.number), ack)
            if first is not ack:
                examination.blame(f"UAV {ack.id} obeys a command twice", _ack(first), _ack(ack))
            later = last.get(ack.term)
            if later and ack.number < later.number:
                what = f"UAV {ack.id} obeys command {ack.number} after {later.number}"
                examination.blame(what, _ack(later), _ack(ack))
            last[ack.term] = ack
    return examination


def repetitions(index: Index) -> Examination:
    """A command that is sent again differs in its sequence number and time of sending alone."""
    examination = Examination()
    first: dict[tuple[int, int, int], Command] = {}
    for command in index.commands:
        original = first.setdefault((command.id, command.term, command.number), command)
        if original is command:
            continue
        examination.examined += 1
        if msgspec.structs.replace(command, seq=original.seq, t_ns=original.t_ns) != original:
            names = [
                f
                for f in command.__struct_fields__
                if f not in ("seq", "t_ns") and getattr(command, f) != getattr(original, f)
            ]
            what = f"command {command.number} of term {command.term} changes when it is sent again"
            fields = (*IDENTITY, *names)
            examination.blame(what, witness(original, *fields), witness(command, *fields))
    return examination


def _told(told: HeardElection, **more: int) -> Witness:
    fields = ("term", "members", "computing")
    return witness(told.election, *fields, heard_ns=told.at_ns, **more)


def _ack(ack: Ack, **more: int) -> Witness:
    return witness(ack, *IDENTITY, "accepted", **more)


def _obeyed(obeyed: Answered, **more: int) -> tuple[Witness, Witness]:
    command = witness(obeyed.command, *IDENTITY, "expiry_ns")
    return command, _ack(obeyed.ack, **more)
