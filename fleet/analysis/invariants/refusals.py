"""Refusals: a command is refused for one of the protocol's reasons, and that is true."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Found, witness
from fleet.analysis.invariants.views import Answered, View
from fleet.model.generate import uavs_of
from fleet.model.tracks import ESCAPES

MANOEUVRES = ESCAPES | {"resume"}


def refusals(index: Index, views: Sequence[View]) -> Found:
    """What a UAV gives as the reason of a refusal is so, by what it had heard and obeyed.

    And it refuses speeds that it may not fly.
    """
    found = Found()
    scenario = index.history.scenario
    bounds = {uav.id: scenario.speeds_mps(uav.speed_mps) for uav in uavs_of(scenario)}
    for view in views:
        for obeyed in view.obeyed:
            if _beyond(obeyed, bounds):
                what = f"UAV {view.uav} obeys a speed that it may not fly"
                told = witness(obeyed.cmd, "term", "number", "speed_mps")
                found.blame(what, told, witness(obeyed.ack, "term", "number", "accepted"))
        for refused in view.refused:
            found.examined += 1
            ack, cmd = refused.ack, refused.cmd
            begun_ns, _ = index.life_of(view.uav, ack.t_ns)
            if ack.reason == "no_mandate" and begun_ns > 0:
                continue  # of mandates an earlier life does not count, and only its terms are known
            beyond = ack.reason == "beyond_limits" and _beyond(refused, bounds)
            holds = TRUE.get(ack.reason)
            if not beyond and (holds is None or not holds(refused)):
                what = f"UAV {ack.id} refuses a command as '{ack.reason}', which it is not"
                heard = refused.newest
                found.blame(
                    what,
                    *([witness(heard.election, "term", "members", "computing")] if heard else []),
                    witness(cmd, "term", "number", "expiry_ns"),
                    witness(ack, "term", "number", "reason", own_clock_ns=refused.local_ns),
                )
    return found


def _beyond(answered: Answered, bounds: Mapping[int, tuple[float, float]]) -> bool:
    """Whether a command asks for a speed that its target may not fly."""
    cmd, (low, high) = answered.cmd, bounds.get(answered.ack.id, (0.0, math.inf))
    return cmd.manoeuvre == "speed" and not low <= (cmd.speed_mps or 0.0) <= high


def _identity(refused: Answered) -> tuple[int, int]:
    return refused.cmd.term, refused.cmd.number


def _newest_term(refused: Answered) -> int:
    return refused.newest.election.term if refused.newest else 0


def _wrong_issuer(refused: Answered) -> bool:
    newest, cmd = refused.newest, refused.cmd
    if newest is None or newest.election.term != cmd.term:
        return False
    return newest.election.computing != cmd.id


def _no_mandate(refused: Answered) -> bool:
    newest = refused.newest
    return newest is None or not newest.from_ns <= refused.local_ns <= newest.until_ns


TRUE: dict[str, Callable[[Answered], bool]] = {
    "wrong_target": lambda r: r.cmd.target != r.ack.id,
    "no_mandate": _no_mandate,
    "stale_term": lambda r: _newest_term(r) > r.cmd.term,
    "unknown_term": lambda r: _newest_term(r) < r.cmd.term,
    "wrong_issuer": _wrong_issuer,
    "expired": lambda r: r.local_ns > r.cmd.expiry_ns,
    "duplicate": lambda r: _identity(r) == r.last,
    "superseded": lambda r: _identity(r) < r.last,
    "unknown_manoeuvre": lambda r: r.cmd.manoeuvre not in MANOEUVRES,
}
"""When each reason is true."""
