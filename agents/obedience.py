"""Which commands a UAV obeys. A refusal has one of these reasons, and is acknowledged with it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fleet.model.election import Mandate
from fleet.model.words import AVOIDING, Manoeuvre
from fleet.protocol.messages import Command

Applied = tuple[int, int]
"""Term and number of a command."""

REFUSAL_REASONS = {
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
FINAL = frozenset(REFUSAL_REASONS) - {"unknown_term", "no_mandate"}
"""Refusals that a retransmission cannot mend."""

FLYABLE_MANOEUVRES = AVOIDING | {Manoeuvre.RESUME}


@dataclass(frozen=True, slots=True)
class Recipient:
    """The UAV that a command has reached, as far as obedience goes.

    `mandate` is the election of the highest term heard that names it among its members;
    `minimum_term` is the highest such term, of earlier incarnations too; `applied` the last command
    obeyed, as (term, number). `speeds_mps` are the least and greatest that it may fly.
    """

    id: int
    mandate: Mandate | None
    applied: Applied
    minimum_term: int = 0
    speeds_mps: tuple[float, float] = (0.0, math.inf)


def refusal(command: Command, uav: Recipient, now_ns: int) -> str:
    """Why a command is not obeyed at `now_ns` by the UAV's clock; empty if it is."""
    mandate = uav.mandate
    if command.target != uav.id:
        return "wrong_target"
    if (command.term, command.number) == uav.applied:
        return "duplicate"
    if command.term < uav.minimum_term:
        return "stale_term"
    if mandate is None:
        return "no_mandate"
    if command.term != mandate.term:
        return "stale_term" if command.term < mandate.term else "unknown_term"
    if command.id != mandate.computing:
        return "wrong_issuer"
    if (command.term, command.number) < uav.applied:
        return "superseded"
    if not mandate.in_force(now_ns):
        return "no_mandate"
    if now_ns > command.expiry_ns:
        return "expired"
    return _unflyable(command, uav.speeds_mps)


def _unflyable(command: Command, speeds_mps: tuple[float, float]) -> str:
    """Why what a command asks for cannot be flown."""
    if command.manoeuvre not in FLYABLE_MANOEUVRES:
        return "unknown_manoeuvre"
    low, high = speeds_mps
    within = command.manoeuvre != Manoeuvre.SPEED or low <= (command.speed_mps or 0.0) <= high
    return "" if within else "beyond_limits"
