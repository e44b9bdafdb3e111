"""Commands: what was obeyed, and what was sent again."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Found, Witness, witness
from fleet.analysis.invariants.views import Answered, Told, View, all_obeyed
from fleet.comms.messages import Ack, Cmd

IDENTITY = ("term", "number")


def fencing(views: Sequence[View]) -> Found:
    """Nothing is obeyed in a term below one in which the UAV was named, or in which it obeyed."""
    found = Found()
    for view in views:
        before: Answered | None = None
        for obeyed in view.obeyed:
            found.examined += 1
            newest, term = obeyed.newest, obeyed.cmd.term
            if newest and newest.election.term > term:
                what = f"UAV {view.uav} obeys term {term}, but has heard of a higher one"
                found.blame(what, _told(newest), *_obeyed(obeyed))
            if before and before.cmd.term > term:
                what = f"UAV {view.uav} obeys term {term} after term {before.cmd.term}"
                found.blame(what, _ack(before.ack), *_obeyed(obeyed))
            before = obeyed
    return found


def issuer(views: Sequence[View]) -> Found:
    """The issuer of what is obeyed is the computing UAV of its term."""
    found = Found()
    for obeyed in all_obeyed(views):
        found.examined += 1
        told = obeyed.mandate or obeyed.foreign
        if told and told.election.computing != obeyed.cmd.id:
            what = f"UAV {obeyed.cmd.id} does not compute in term {obeyed.cmd.term}"
            found.blame(what, _told(told), *_obeyed(obeyed))
    return found


def own_group(views: Sequence[View]) -> Found:
    """The target of what is obeyed is in the group of its term."""
    found = Found()
    for obeyed in all_obeyed(views):
        found.examined += 1
        if obeyed.mandate is None:
            uav, term = obeyed.ack.id, obeyed.cmd.term
            what = f"no election of term {term} that UAV {uav} has heard names it"
            foreign = [_told(obeyed.foreign)] if obeyed.foreign else []
            found.blame(what, *foreign, *_obeyed(obeyed))
    return found


def in_time(views: Sequence[View]) -> Found:
    """Nothing is obeyed after its expiry or out of its mandate's time, by the clock of the UAV."""
    found = Found()
    for obeyed in all_obeyed(views):
        found.examined += 1
        ack, cmd = obeyed.ack, obeyed.cmd
        local_ns = obeyed.local_ns
        if local_ns > cmd.expiry_ns:
            what = f"UAV {ack.id} obeys a command that has expired"
            found.blame(what, *_obeyed(obeyed, own_clock_ns=local_ns))
        if obeyed.mandate and local_ns < obeyed.mandate.from_ns:
            what = f"UAV {ack.id} obeys in term {cmd.term} before it heard of it"
            told = _told(obeyed.mandate, from_ns=obeyed.mandate.from_ns)
            found.blame(what, told, *_obeyed(obeyed, own_clock_ns=local_ns))
        if obeyed.mandate and local_ns > obeyed.mandate.until_ns:
            what = f"UAV {ack.id} obeys in term {cmd.term}, which has run out"
            told = _told(obeyed.mandate, until_ns=obeyed.mandate.until_ns)
            found.blame(what, told, *_obeyed(obeyed, own_clock_ns=local_ns))
    return found


def once(views: Sequence[View]) -> Found:
    """Nothing is obeyed twice, and of one term nothing that was numbered before the last."""
    found = Found()
    for view in views:
        done: dict[tuple[int, int, int], Ack] = {}
        last: dict[int, Ack] = {}
        for obeyed in view.obeyed:
            found.examined += 1
            ack = obeyed.ack
            first = done.setdefault((ack.target, ack.term, ack.number), ack)
            if first is not ack:
                found.blame(f"UAV {ack.id} obeys a command twice", _ack(first), _ack(ack))
            later = last.get(ack.term)
            if later and ack.number < later.number:
                what = f"UAV {ack.id} obeys command {ack.number} after {later.number}"
                found.blame(what, _ack(later), _ack(ack))
            last[ack.term] = ack
    return found


def repetitions(index: Index) -> Found:
    """A command that is sent again differs in its sequence number and time of sending alone."""
    found = Found()
    first: dict[tuple[int, int, int], Cmd] = {}
    for cmd in index.cmds:
        original = first.setdefault((cmd.id, cmd.term, cmd.number), cmd)
        if original is cmd:
            continue
        found.examined += 1
        if msgspec.structs.replace(cmd, seq=original.seq, t_ns=original.t_ns) != original:
            names = [
                f
                for f in cmd.__struct_fields__
                if f not in ("seq", "t_ns") and getattr(cmd, f) != getattr(original, f)
            ]
            what = f"command {cmd.number} of term {cmd.term} changes when it is sent again"
            fields = (*IDENTITY, *names)
            found.blame(what, witness(original, *fields), witness(cmd, *fields))
    return found


def _told(told: Told, **more: int) -> Witness:
    fields = ("term", "members", "computing")
    return witness(told.election, *fields, heard_ns=told.at_ns, **more)


def _ack(ack: Ack, **more: int) -> Witness:
    return witness(ack, *IDENTITY, "accepted", **more)


def _obeyed(obeyed: Answered, **more: int) -> tuple[Witness, Witness]:
    cmd = witness(obeyed.cmd, *IDENTITY, "expiry_ns")
    return cmd, _ack(obeyed.ack, **more)
