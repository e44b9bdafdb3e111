"""Which commands a UAV obeys. A refusal has one of these reasons, and is acknowledged with it."""

from __future__ import annotations

from collections.abc import Container

from fleet.comms.messages import Cmd
from fleet.model.election import Mandate
from fleet.model.tracks import CommandId

REASONS = {
    "wrong_target": "the command is addressed to another UAV",
    "no_mandate": "no election that names this UAV has been heard, or the last one has run out",
    "stale_term": "a later election names this UAV",
    "unknown_term": "the election of this term has not been heard (yet)",
    "wrong_issuer": "the issuer is not the computing UAV of this term",
    "expired": "the command arrived after its expiry",
    "duplicate": "this command was applied before",
    "unknown_manoeuvre": "the manoeuvre is none of turn, climb, turn_climb, resume",
}
FINAL = frozenset(REASONS) - {"unknown_term", "no_mandate"}
"""Refusals that a retransmission cannot mend."""

MANOEUVRES = frozenset({"turn", "climb", "turn_climb", "resume"})


def refusal(
    cmd: Cmd, own: int, mandate: Mandate | None, applied: Container[CommandId], now_ns: int
) -> str:
    """Why a command is not obeyed at `now_ns`; empty if it is.

    `mandate` is the election of the highest term heard that names this UAV among its members.
    """
    if cmd.target != own:
        return "wrong_target"
    if CommandId(cmd.term, cmd.id, cmd.number) in applied:
        return "duplicate"
    if mandate is None:
        return "no_mandate"
    if cmd.term != mandate.term:
        return "stale_term" if cmd.term < mandate.term else "unknown_term"
    if cmd.id != mandate.computing:
        return "wrong_issuer"
    if now_ns > mandate.valid_until_ns:
        return "no_mandate"
    if now_ns > cmd.expiry_ns:
        return "expired"
    return "" if cmd.manoeuvre in MANOEUVRES else "unknown_manoeuvre"
