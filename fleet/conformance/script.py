"""What is played to a UAV in lockstep: who says what in which tick, and what has to come of it.

Terms: of three UAVs and a coordinator, term t is the coordinator's if t is divisible by 4, UAV n's
if the remainder is n. Ticks are of 0.1 s; an election is valid for 1 s.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

import msgspec

from fleet.conformance.scene import FOREIGN
from fleet.faults.plan import plan_of
from fleet.faults.rules import Rule
from fleet.model.types import COORDINATOR
from fleet.protocol import codec
from fleet.protocol.messages import Ack, Command, Election, Heartbeat, Message

TICK_NS = 100_000_000


class How(Enum):
    """How a message is brought."""

    LISTED = auto()
    EARLY = auto()
    """Before its tick is granted, as by a UAV that was granted it earlier."""
    LATE = auto()
    """After the grant that lists it."""
    UNLISTED = auto()
    """No manifest ever lists it."""


@dataclass(frozen=True)
class Cue:
    """Something is said in a tick; `reason` is why a command has to be refused ("": obeyed)."""

    tick: int
    message: Message
    label: str = ""
    reason: str = ""
    how: How = How.LISTED


@dataclass(frozen=True)
class CommandCue(Cue):
    """UAV 1, or whoever it says, commands the foreign UAV."""

    message: Command


def command(tick: int, term: int, number: int, manoeuvre: str = "turn", **changes: Any) -> Command:
    """A command of UAV 1; it starts 0.2 s later, lasts for 3 s, and expires after 2 s."""
    now_ns = tick * TICK_NS
    made = Command(
        id=1,
        seq=0,
        t_ns=now_ns,
        target=FOREIGN,
        term=term,
        number=number,
        issued_ns=now_ns,
        manoeuvre=manoeuvre,
        heading_rad=0.6 if "turn" in manoeuvre else 0.0,
        turn_rad=0.6 if "turn" in manoeuvre else 0.0,
        climb_mps=3.0 if "climb" in manoeuvre else 0.0,
        level_down_m=-400.0 if "climb" in manoeuvre else 0.0,
        start_ns=now_ns + 2 * TICK_NS,
        manoeuvre_end_ns=now_ns + 30 * TICK_NS,
        expiry_ns=now_ns + 20 * TICK_NS,
    )
    return msgspec.structs.replace(made, **changes)


def election(tick: int, term: int, **changes: Any) -> Election:
    """The coordinator elects UAV 1 for itself and the foreign UAV."""
    now_ns = tick * TICK_NS
    made = Election(COORDINATOR, 0, now_ns, term, 1, (1, FOREIGN), 1, now_ns + 10 * TICK_NS)
    return msgspec.structs.replace(made, **changes)


def _named(tick: int, label: str, reason: str, *given: Any, **changes: Any) -> CommandCue:
    how = changes.pop("how", How.LISTED)
    return CommandCue(tick, command(tick, *given, **changes), label, reason, how)


UNELECTED = _named(3, "before any election", "no_mandate", 4, 1)
OBEYED = _named(12, "to be obeyed", "", 4, 3)
REPEATED = CommandCue(15, OBEYED.message, "repeated", "duplicate")
RESUMED = _named(36, "late, resume", "", 4, 10, "resume", how=How.LATE)
EARLIER = _named(30, "while one of the next tick is there already", "", 4, 7, "climb")
EARLY = _named(31, "early", "wrong_issuer", 4, 51, id=3, how=How.EARLY)
UNLISTED = _named(34, "that no manifest lists", "", 4, 9, how=How.UNLISTED)
AFTER_ELECTION = _named(39, "of a term that begins in its tick", "", 8, 11)
AFTER_LOCAL = _named(41, "of a term that its issuer begins in its tick", "", 9, 12)
LAPSING = _named(58, "that lapses", "", 16, 20, "climb", manoeuvre_end_ns=65 * TICK_NS)
FASTER = _named(65, "to fly faster", "", 16, 21, "speed", speed_mps=28.0)

LOCKSTEP_COMMANDS: tuple[CommandCue, ...] = (
    UNELECTED,
    OBEYED,
    REPEATED,
    _named(16, "older than the last obeyed", "superseded", 4, 2),
    _named(18, "of who does not compute", "wrong_issuer", 4, 50, id=3),
    _named(20, "that has expired", "expired", 4, 4, expiry_ns=19 * TICK_NS),
    _named(22, "of no manoeuvre", "unknown_manoeuvre", 4, 5, "wiggle"),
    _named(24, "of an impossible speed", "beyond_limits", 4, 6, "speed", speed_mps=500.0),
    _named(26, "of a term not begun", "unknown_term", 8, 1),
    EARLIER,
    EARLY,
    UNLISTED,
    RESUMED,
    AFTER_ELECTION,
    AFTER_LOCAL,
    _named(44, "of an old term", "stale_term", 8, 13),
    _named(54, "when the mandate has run out", "no_mandate", 9, 14),
    LAPSING,
    FASTER,
    _named(70, "when the mandate would last longer than it may", "no_mandate", 16, 22),
)
"""The commands, with why each has to be refused, or none if it has to be obeyed."""

LOWER, NOT_ITS_OWN, OF_ANOTHER, OTHER_GROUP = 46, 47, 48, 49
"""When elections come that are no mandate."""
LEARNED = 52
"""When a heartbeat tells of a higher term."""
RUN_OUT, TOO_LONG = 53, 69
"""When a mandate has ended."""

LOCKSTEP_ELECTIONS: tuple[Cue, ...] = (
    *(Cue(tick, election(tick, 4)) for tick in range(8, 38, 4)),
    Cue(39, election(39, 8)),
    Cue(41, election(41, 9, id=1)),
    Cue(LOWER, election(LOWER, 4)),
    Cue(NOT_ITS_OWN, election(NOT_ITS_OWN, 13)),
    Cue(OF_ANOTHER, election(OF_ANOTHER, 15, id=3)),
    Cue(OTHER_GROUP, election(OTHER_GROUP, 12, members=(1, 3))),
    Cue(LEARNED, Heartbeat(COORDINATOR, 0, LEARNED * TICK_NS, 16)),
    Cue(56, election(56, 16, valid_until_ns=156 * TICK_NS)),
)

SILENT = range(74, 88)
"""When nobody broadcasts."""
HELD = range(90, 93)
FORGED = 95
"""When somebody grants a tick that is not the next."""
STRANGE = 97
"""When strangers speak, and garbage comes."""
FAULTS_BEGIN = 100
"""From when the fault plan is in force; each rule for as long as `FAULT_TICKS` ticks."""
FAULT_TICKS = 7

PLAN_KEYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("loss", {"probability": 0.5}),
    ("latency", {"base_s": 0.2, "jitter_s": 0.25}),
    ("duplicate", {"probability": 0.5, "delay_s": 0.15}),
    ("reorder", {"probability": 0.5, "delay_s": 0.4}),
    ("burst", {"loss": 0.5, "mean_ticks": 2.0}),
    ("partition", {"groups": "1,coordinator/2"}),
    ("corrupt", {"probability": 0.5}),
    ("replay", {"probability": 0.5, "delay_s": 1.0}),
    ("rate", {"bits_per_s": 4000.0, "queue": 2}),
    ("range", {"model": "rayleigh", "scale_m": 1000.0}),
)
"""The rules of the plan, one after the other."""


def fault_plan() -> tuple[Rule, ...]:
    """Each kind about links in a window of its own, so that each is judged by itself."""
    table = []
    for n, (kind, keys) in enumerate(PLAN_KEYS):
        begin = FAULTS_BEGIN + n * FAULT_TICKS
        window = {"start_s": begin / 10, "end_s": (begin + FAULT_TICKS) / 10}
        table.append({"kind": kind, **window, **keys})
    return plan_of(msgspec.json.encode(table).decode())


def cues(tick: int) -> Iterator[Cue]:
    """What the script has of a tick; commands before the elections that they need."""
    yield from (cue for cue in LOCKSTEP_COMMANDS if cue.tick == tick)
    yield from (cue for cue in LOCKSTEP_ELECTIONS if cue.tick == tick)
    now_ns = tick * TICK_NS
    if tick % 4 == 0 or tick >= FAULTS_BEGIN:
        yield Cue(tick, Heartbeat(COORDINATOR, 0, now_ns, 0))
    if tick >= FAULTS_BEGIN:  # something to lose of every class and from everybody
        for issuer in (1, 3):
            answer = Ack(
                issuer, 0, now_ns, FOREIGN, 1, 1, 0, accepted=True, reason="", actuate_ns=0
            )
            yield Cue(tick, answer)


NAN = float("nan")


def garbage(broadcast: Message) -> list[tuple[str, bytes]]:
    """Topics and payloads that no participant can have sent."""
    table = msgspec.to_builtins(broadcast)
    nan = msgspec.msgpack.encode({**table, "speed_mps": NAN, "seq": 10**6})
    short = msgspec.msgpack.encode({"id": 1, "seq": 10**6})
    stranger = msgspec.msgpack.encode({**table, "id": 99, "seq": 1})
    return [
        ("1/adsb/0", b"\xc1"),
        ("1/adsb/0", b""),
        ("1/adsb/0", nan),
        ("1/adsb/0", short),
        ("3/adsb/0", msgspec.msgpack.encode(table)),
        ("99/adsb/0", stranger),
        (f"1/cmd/{FOREIGN}", b"\x80"),
        ("1/heartbeat", codec.encode(Heartbeat(1, 10**6, broadcast.t_ns, 1))),
    ]
