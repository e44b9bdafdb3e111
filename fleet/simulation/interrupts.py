"""Ctrl-C, SIGTERM and a terminal that is closed end a run, but never in the middle of a record."""

from __future__ import annotations

import os
import signal
import stat
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any, Self

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
WHY = {
    signal.SIGINT: "interrupted by the user",
    signal.SIGTERM: "ended by SIGTERM",
    signal.SIGHUP: "ended by SIGHUP: the terminal was closed",
}


def end_command(number: int, _frame: FrameType | None = None) -> None:
    """Handler of a signal that ends a command; raises KeyboardInterrupt."""
    if number == signal.SIGHUP:
        _hang_up()
    raise KeyboardInterrupt


def take_over(handler: Callable[[int, FrameType | None], None]) -> dict[signal.Signals, Any]:
    """Have the signals that are not ignored handled so; returns what handled them before."""
    heeded = [n for n in SIGNALS if signal.getsignal(n) is not signal.SIG_IGN]
    return {number: signal.signal(number, handler) for number in heeded}


def _hang_up() -> None:
    """The terminal has been closed.

    The kernel and the shell both tell of it, and the second time must not cut the ending short.
    Standard streams that lead to the terminal fail at every word from now on: they go nowhere
    instead, or the first word about the ending would be the end of it.
    """
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        with suppress(OSError):
            if stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream):
                os.dup2(nowhere, stream)
    os.close(nowhere)


class Interrupts:
    """Raises KeyboardInterrupt on a signal: at once, or after the section that holds it off.

    `with interrupts:` is such a section; `install` and `restore` frame the run. A signal that was
    ignored before stays ignored.
    """

    def __init__(self) -> None:
        self._held = False
        self._pending = False
        self.why = WHY[signal.SIGINT]
        self._before: dict[signal.Signals, Any] = {}

    def install(self) -> None:
        """Take the signals over; does nothing on another than the main thread."""
        if threading.current_thread() is threading.main_thread():
            self._before = take_over(self._handle)

    def restore(self) -> None:
        """Give the signals back, but for that of a terminal which has been closed."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

    def __enter__(self) -> Self:
        """Hold interrupts off."""
        self._held = True
        return self

    def __exit__(self, *_: object) -> None:
        """Let them through again; one that came meanwhile is raised now."""
        self._held = False
        if self._pending:
            self._pending = False
            raise KeyboardInterrupt

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        self.why = WHY[signal.Signals(number)]
        if number == signal.SIGHUP:
            _hang_up()
            self._before.pop(signal.SIGHUP, None)
        if self._held:
            self._pending = True
        else:
            raise KeyboardInterrupt
