"""Words that stand in scenarios, messages and logs, each set in one place.

What is read from a bus or a log may hold other words: those are text, shown and not looked up.
"""

from __future__ import annotations

from enum import StrEnum


class ClockMode(StrEnum):
    """The two clocks: granted tick by tick, or the wall's."""

    LOCKSTEP = "lockstep"
    REALTIME = "realtime"


class BusKind(StrEnum):
    """The two buses: zenoh, or the memory of one process."""

    ZENOH = "zenoh"
    MEMORY = "memory"


class OnLogError(StrEnum):
    """What becomes of a run whose log cannot be written."""

    STOP = "stop"
    CONTINUE = "continue"


class ClockState(StrEnum):
    """What the simulation says with a clock: it begins, goes on, has another fault plan, or ends.

    Epochs and changes of the plan are said in realtime alone.
    """

    EPOCH = "epoch"
    RUN = "run"
    PLAN = "plan"
    STOP = "stop"


class Manoeuvre(StrEnum):
    """What an advisory or a command asks for; KEEP (advisories only) the one that is flown."""

    TURN = "turn"
    CLIMB = "climb"
    TURN_CLIMB = "turn_climb"
    SPEED = "speed"
    RESUME = "resume"
    KEEP = "keep"


class Mode(StrEnum):
    """What a UAV does that flies no manoeuvre: its plan, on after it, or nobody is in control."""

    PLAN = "plan"
    ARRIVED = "arrived"
    HELD = "held"
    UNMANNED = "unmanned"


class OutageEnd(StrEnum):
    """How an outage ended: heard again, a new process in its place, or not by the end."""

    BACK = "back"
    RESTARTED = "restarted"
    LOST = "lost"


class ArrivalFate(StrEnum):
    """What became of a message that arrived: as sent, with bits flipped, or not believed.

    The fate of one that did not arrive is the kind of the fault that kept it away.
    """

    RECEIVED = "received"
    ALTERED = "altered"
    IMPLAUSIBLE = "implausible"


TURNING = frozenset({Manoeuvre.TURN, Manoeuvre.TURN_CLIMB})
CLIMBING = frozenset({Manoeuvre.CLIMB, Manoeuvre.TURN_CLIMB})
AVOIDING = TURNING | CLIMBING | {Manoeuvre.SPEED}
"""The manoeuvres that a UAV flies instead of its plan; modes, too."""
UNMANNED = frozenset({Mode.HELD, Mode.UNMANNED})
"""Modes in which nobody is in control: the aircraft flies on."""
AS_PLANNED = frozenset({Mode.PLAN, Mode.ARRIVED})
