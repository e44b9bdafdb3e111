"""Ctrl-C and SIGTERM end a run, but never in the middle of a record."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """Raises KeyboardInterrupt on a signal: at once, or after the section that holds it off.

    `with interrupts:` is such a section; `install` and `restore` frame the run. A signal that was
    ignored before stays ignored.
    """

    def __init__(self) -> None:
        self._held = False
        self._pending = False
        self._before: dict[signal.Signals, object] = {}

    def install(self) -> None:
        """Take the signals over; does nothing on another than the main thread."""
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._handle)

    def restore(self) -> None:
        """Give the signals back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
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

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        if self._held:
            self._pending = True
        else:
            raise KeyboardInterrupt
