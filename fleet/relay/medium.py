"""What a relay's dialogue goes over: one question, one answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from fleet.relay.questions import RelayQuestion
from fleet.transport.zenoh_bus import Bus

LONGEST_ANSWER_BYTES = 1 << 20
TOO_LONG = f"its program answers more than {LONGEST_ANSWER_BYTES} bytes at once"
STOP_S = 2.0
"""So long a program may take to end when it is told to stop."""


@dataclass(frozen=True)
class AnswerLimits:
    """How long an answer may take, and how long a program may be away that comes back."""

    timeout_s: float
    return_s: float = 0.0


FIRM = AnswerLimits(86_400.0)
"""In lockstep the simulation ends a run that stands still, long before that."""
REALTIME_RETURN_S = 3.0
"""Who was cut off from the router, with its program, is not there again at the same moment."""


class Medium(Protocol):
    """The way to the program that flies a UAV; `begin` comes first, `end` last."""

    def begin(self, bus: Bus, question: RelayQuestion, wait_s: float) -> None:
        """Ask the first question; raises ProgramError if nobody answers within that time."""
        ...

    def ask(self, question: RelayQuestion, limits: AnswerLimits) -> object:
        """The answer, of built-in types; raises ProgramError."""
        ...

    def end(self, question: RelayQuestion) -> None:
        """Tell it to stop, if it has not been given up, and wait a little; raises nothing."""
        ...

    def abandon(self) -> None:
        """Ask it nothing more."""
        ...
