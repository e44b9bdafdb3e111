"""What is played to a UAV in realtime: who says what at which tick of the wall clock."""

from __future__ import annotations

from collections.abc import Iterator

from fleet.conformance.scene import FOREIGN
from fleet.conformance.script import TICK_NS, CommandCue, Cue, How, command, election
from fleet.faults.plan import plan_of
from fleet.faults.rules import Rule
from fleet.model.types import COORDINATOR
from fleet.protocol.messages import Ack, Heartbeat

REALTIME_OBEYED = CommandCue(10, command(10, 4, 2), "to be obeyed")
STRANGERS = 13
"""When strangers speak, and garbage comes."""
REPLAYED = 14
"""When the last command comes again under its old number."""
FUTURE = 17
"""When a broadcast comes that is from the future."""
FUTURE_NS = 10_000_000_000
ANNOUNCED, LOSSY, HEALED = 18, 20, 34
"""When the fault plan is told, and from when to when it is in force."""

REALTIME_COMMANDS: tuple[CommandCue, ...] = (
    CommandCue(3, command(3, 4, 1), "before any election", "no_mandate"),
    REALTIME_OBEYED,
    CommandCue(12, REALTIME_OBEYED.message, "repeated", "duplicate"),
    CommandCue(15, command(15, 4, 50, id=3), "of who does not compute", "wrong_issuer"),
    CommandCue(16, command(16, 4, 3, expiry_ns=10 * TICK_NS), "that has expired", "expired"),
)
"""The commands, and why each has to be refused, or none."""


def realtime_plan() -> tuple[Rule, ...]:
    """Half of all is lost, the rest comes later."""
    window = f'"start_s": {LOSSY / 10}, "end_s": {HEALED / 10}'
    return plan_of(
        f'[{{"kind": "loss", "probability": 0.5, {window}}}, '
        f'{{"kind": "latency", "base_s": 0.2, "jitter_s": 0.1, {window}}}]'
    )


def realtime_cues(tick: int) -> Iterator[Cue]:
    """What the script has of a tick."""
    yield from (cue for cue in REALTIME_COMMANDS if cue.tick == tick)
    if tick % 4 == 2 and tick > 4:
        yield Cue(tick, election(tick, 4))
    if tick % 4 == 0 or LOSSY <= tick < HEALED:
        yield Cue(tick, Heartbeat(COORDINATOR, 0, 0, 0))
    if LOSSY <= tick < HEALED:
        for issuer in (1, 3):
            answer = Ack(issuer, 0, 0, FOREIGN, 1, 1, 0, accepted=True, reason="", actuate_ns=0)
            yield Cue(tick, answer, how=How.LISTED)
