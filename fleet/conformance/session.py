"""A session of the conformance test: a router at an endpoint, a play, and what the rules say."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence

from fleet.conformance.evidence import Evidence
from fleet.conformance.lockstep_play import LockstepPlay
from fleet.conformance.play import Play
from fleet.conformance.realtime_play import RealtimePlay
from fleet.conformance.rule import Outcome, RuleFinding, judged
from fleet.conformance.rules import RULES
from fleet.conformance.scene import LOCKSTEP_S, REALTIME_S, played_scenario
from fleet.model.words import ClockMode
from fleet.transport.zenoh_bus import open_router_bus

PLAYS: dict[ClockMode, tuple[type[Play], float]] = {
    ClockMode.LOCKSTEP: (LockstepPlay, LOCKSTEP_S),
    ClockMode.REALTIME: (RealtimePlay, REALTIME_S),
}
"""Each clock's play, and how long it lasts."""


def played(
    endpoint: str,
    clock: ClockMode,
    *,
    wait_s: float,
    patience_s: float,
    listening: Callable[[str], None] = lambda _: None,
    gone: Callable[[], bool] = lambda: False,
) -> Evidence:
    """Play to the UAV that joins at an endpoint; `listening` is told where, once it can.

    Who is `gone` before it has joined is not waited for.

    Raises:
        BusError: the endpoint is malformed or taken.

    """
    bus, where = open_router_bus(f"conform-{secrets.token_hex(2)}", "sim", endpoint)
    with bus:
        play, duration_s = PLAYS[clock]
        return play(bus, played_scenario(duration_s), clock, patience_s).perform(
            wait_s, lambda: listening(where), gone
        )


def found(evidence: Evidence) -> list[RuleFinding]:
    """What became of each rule of its clock."""
    return [*judged(evidence, RULES)]


def exit_code(findings: Sequence[RuleFinding]) -> int:
    """0: all are kept; 1: one is broken; 2: nothing is broken, but not all were tried."""
    outcomes = {finding.outcome for finding in findings}
    if Outcome.BROKEN in outcomes:
        return 1
    return 0 if outcomes == {Outcome.KEPT} else 2
