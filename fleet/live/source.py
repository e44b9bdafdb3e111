"""Where the page's frames come from, and where what viewers change goes to."""

from __future__ import annotations

from typing import Protocol

from msgspec import Struct

from fleet.simulation.live_feed import LiveFrame


class Change(Struct, frozen=True, forbid_unknown_fields=True):
    """What a viewer asks for: faults by the names of options as `fleet fault` has them, or a pace.

    `end` are numbers of rules in the plan that are to end. `to_s` is a time to go to, in a log.
    """

    faults: dict[str, list[str]] = {}
    clear: bool = False
    end: tuple[int, ...] = ()
    paused: bool | None = None
    speed: float | None = None
    steps: int = 0
    to_s: float | None = None


class ChangeOutcome(Struct, frozen=True):
    """What came of a change, in words."""

    good: bool
    text: str


class Source(Protocol):
    """A run that is on, or a log."""

    title: str
    recorded: bool

    def frame(self, after: int, *, whole: bool = False) -> LiveFrame | None:
        """The newest frame, with events after a number; None if there is none just now."""
        ...

    def past(self, t_ns: int) -> LiveFrame | None:
        """Where all were at an earlier time, and no more; None where the present alone is known."""
        ...

    def is_over(self) -> bool:
        """Whether there will be no more."""
        ...

    def change(self, change: Change) -> ChangeOutcome:
        """Carry out what a viewer asks for."""
        ...

    def close(self) -> None:
        """Leave what it reads from."""
        ...
