"""Which commands a UAV obeys. A refusal has one of these reasons, and is acknowledged with it."""

from __future__ import annotations

import math

from fleet.comms.messages import Cmd
from fleet.model.election import Mandate
from fleet.model.tracks import ESCAPES

Applied = tuple[int, int]
"""Term and number of a command."""

REASONS = {
    "wrong_target": "the command is addressed to another UAV",
    "no_mandate": "no election that names this UAV has been heard, or the last one has run out",
    "stale_term": "a later election names this UAV",
    "unknown_term": "the election of this term has not been heard (yet)",
    "wrong_issuer": "the issuer is not the computing UAV of this term",
    "expired": "the command arrived after its expiry",
    "duplicate": "this command was applied before",
    "superseded": "a later command of the same term was applied before",
    "unknown_manoeuvre": "the manoeuvre is none of turn, climb, turn_climb, speed, resume",
    "beyond_limits": "it is no speed that the UAV may fly",
}
FINAL = frozenset(REASONS) - {"unknown_term", "no_mandate"}
"""Refusals that a retransmission cannot mend."""

MANOEUVRES = ESCAPES | {"resume"}


def refusal(
    cmd: Cmd,
    own: int,
    mandate: Mandate | None,
    applied: Applied,
    now_ns: int,
    fence: int = 0,
    speeds_mps: tuple[float, float] = (0.0, math.inf),
) -> str:
    """Why a command is not obeyed at `now_ns` by the UAV's clock; empty if it is.

    `mandate` is the election of the highest term heard that names this UAV among its members;
    `fence` is the highest such term of an earlier life, and `applied` the last command applied,
    as (term, number). `speeds_mps` are the least and greatest that it may fly.
    """
    if cmd.target != own:
        return "wrong_target"
    if (cmd.term, cmd.number) == applied:
        return "duplicate"
    if cmd.term < fence:
        return "stale_term"
    if mandate is None:
        return "no_mandate"
    if cmd.term != mandate.term:
        return "stale_term" if cmd.term < mandate.term else "unknown_term"
    if cmd.id != mandate.computing:
        return "wrong_issuer"
    if (cmd.term, cmd.number) < applied:
        return "superseded"
    if not mandate.in_force(now_ns):
        return "no_mandate"
    if now_ns > cmd.expiry_ns:
        return "expired"
    return _unflyable(cmd, speeds_mps)


def _unflyable(cmd: Cmd, speeds_mps: tuple[float, float]) -> str:
    """Why what a command asks for cannot be flown."""
    if cmd.manoeuvre not in MANOEUVRES:
        return "unknown_manoeuvre"
    low, high = speeds_mps
    within = cmd.manoeuvre != "speed" or low <= (cmd.speed_mps or 0.0) <= high
    return "" if within else "beyond_limits"
