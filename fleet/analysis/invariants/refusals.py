"""Refusals: a command is refused for one of the protocol's reasons, and that is true."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Examination, witness
from fleet.analysis.invariants.views import Answered, View
from fleet.config.traffic import uavs_of
from fleet.model.words import AVOIDING, Manoeuvre

KNOWN_MANOEUVRES = AVOIDING | {Manoeuvre.RESUME}


def refusals(index: Index, views: Sequence[View]) -> Examination:
    """What a UAV gives as the reason of a refusal is so, by what it had heard and obeyed.

    And it refuses speeds that it may not fly.
    """
    examination = Examination()
    scenario = index.run.scenario
    bounds = {uav.id: scenario.speeds_mps(uav.id, uav.speed_mps) for uav in uavs_of(scenario)}
    for view in views:
        for obeyed in view.obeyed:
            if _beyond(obeyed, bounds):
                what = f"UAV {view.uav} obeys a speed that it may not fly"
                told = witness(obeyed.command, "term", "number", "speed_mps")
                examination.blame(what, told, witness(obeyed.ack, "term", "number", "accepted"))
        for refused in view.refused:
            examination.examined += 1
            ack, command = refused.ack, refused.command
            begun_ns, _ = index.absences.incarnation_of(view.uav, ack.t_ns)
            if ack.reason == "no_mandate" and begun_ns > 0:
                continue  # of an earlier incarnation only the terms are known
            beyond = ack.reason == "beyond_limits" and _beyond(refused, bounds)
            holds = TRUE.get(ack.reason)
            if not beyond and (holds is None or not holds(refused)):
                what = f"UAV {ack.id} refuses a command as '{ack.reason}', which it is not"
                heard = refused.newest
                examination.blame(
                    what,
                    *([witness(heard.election, "term", "members", "computing")] if heard else []),
                    witness(command, "term", "number", "expiry_ns"),
                    witness(ack, "term", "number", "reason", own_clock_ns=refused.local_ns),
                )
    return examination


def _beyond(answered: Answered, bounds: Mapping[int, tuple[float, float]]) -> bool:
    """Whether a command asks for a speed that its target may not fly."""
    command, (low, high) = answered.command, bounds.get(answered.ack.id, (0.0, math.inf))
    return command.manoeuvre == Manoeuvre.SPEED and not low <= (command.speed_mps or 0.0) <= high


def _identity(refused: Answered) -> tuple[int, int]:
    return refused.command.term, refused.command.number


def _newest_term(refused: Answered) -> int:
    return refused.newest.election.term if refused.newest else 0


def _wrong_issuer(refused: Answered) -> bool:
    newest, command = refused.newest, refused.command
    if newest is None or newest.election.term != command.term:
        return False
    return newest.election.computing != command.id


def _no_mandate(refused: Answered) -> bool:
    newest = refused.newest
    return newest is None or not newest.from_ns <= refused.local_ns <= newest.until_ns


TRUE: dict[str, Callable[[Answered], bool]] = {
    "wrong_target": lambda r: r.command.target != r.ack.id,
    "no_mandate": _no_mandate,
    "stale_term": lambda r: _newest_term(r) > r.command.term,
    "unknown_term": lambda r: _newest_term(r) < r.command.term,
    "wrong_issuer": _wrong_issuer,
    "expired": lambda r: r.local_ns > r.command.expiry_ns,
    "duplicate": lambda r: _identity(r) == r.last,
    "superseded": lambda r: _identity(r) < r.last,
    "unknown_manoeuvre": lambda r: r.command.manoeuvre not in KNOWN_MANOEUVRES,
}
"""When each reason is true."""
