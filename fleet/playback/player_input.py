"""The player's real surroundings: the steady clock, and the keys of a terminal."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Iterator, Sequence
from types import FrameType

from fleet.playback.player import PlayerKey

KEYS_BY_SEQUENCE = {
    b" ": PlayerKey.PAUSE,
    b"\x1b[C": PlayerKey.NEXT,
    b"\x1bOC": PlayerKey.NEXT,
    b"\x1b[A": PlayerKey.FASTER,
    b"\x1bOA": PlayerKey.FASTER,
    b"\x1b[B": PlayerKey.SLOWER,
    b"\x1bOB": PlayerKey.SLOWER,
}
"""What a terminal sends for the keys, in both of its modes for arrows."""


def keys_in(typed: bytes) -> tuple[list[PlayerKey], bytes]:
    """The keys in what was typed, others left out, and what may be the beginning of one more."""
    found = []
    while typed:
        code = next((c for c in KEYS_BY_SEQUENCE if typed.startswith(c)), b"")
        if code:
            found.append(KEYS_BY_SEQUENCE[code])
        elif any(c.startswith(typed) for c in KEYS_BY_SEQUENCE):
            break
        typed = typed[len(code) or 1 :]
    return found, typed


class TimeOnly:
    """A steady clock and nobody at the keys."""

    def now_ns(self) -> int:
        """Time of the steady clock."""
        return time.monotonic_ns()

    def wait(self, until_ns: int) -> Sequence[PlayerKey]:
        """Wait; there are no keys."""
        left_s = (until_ns - time.monotonic_ns()) / 1e9
        if left_s > 0:
            time.sleep(left_s)
        return ()


class TerminalKeys(TimeOnly):
    """The same, with keys from a terminal that hands them over one by one."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._typed = b""

    def wait(self, until_ns: int) -> Sequence[PlayerKey]:
        """Wait for a key; raises KeyboardInterrupt if the terminal has gone."""
        left_s = max(0.0, (until_ns - time.monotonic_ns()) / 1e9)
        ready, _, _ = select.select([self._fd], [], [], left_s)
        if not ready:
            return ()
        try:
            typed = os.read(self._fd, 1024)
        except OSError:
            typed = b""
        if not typed:
            raise KeyboardInterrupt
        keys, self._typed = keys_in(self._typed + typed)
        return keys


def has_keys() -> bool:
    """Whether somebody can press keys: standard input is a terminal that listens to this process.

    To set the terminal up from the background would stop the process.
    """
    try:
        fd = sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):  # there is no standard input
        return False
    if not os.isatty(fd):
        return False
    try:
        return os.tcgetpgrp(fd) == os.getpgrp()
    except OSError:  # a terminal, but not the one that controls this process: nothing to disturb
        return True


@contextlib.contextmanager
def player_input() -> Iterator[TimeOnly]:
    """The real clock, with keys if there is a terminal; it is given back as it was found."""
    if not has_keys():
        yield TimeOnly()
        return
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)

    def again(_number: int, _frame: FrameType | None) -> None:
        if has_keys():
            tty.setcbreak(fd)

    handler = signal.signal(signal.SIGCONT, again)  # the shell has changed it in between
    try:
        tty.setcbreak(fd)
        yield TerminalKeys(fd)
    finally:
        signal.signal(signal.SIGCONT, handler)
        if has_keys():
            with contextlib.suppress(termios.error):  # it may have gone
                termios.tcsetattr(fd, termios.TCSADRAIN, before)
