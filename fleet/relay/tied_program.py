"""Becomes a program that does not outlive the relay: `tied_program.py PID PROGRAM ARG...`.

Run as a script, by the relay alone. A program that reads its standard input sees the end of the
relay anyway; on Linux the kernel kills also one that does not.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1
CANNOT_START_EXIT = 127


def _become(relay: int, program: list[str]) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != relay:  # it has ended meanwhile
        return
    try:
        os.execvp(program[0], program)  # noqa: S606 (the user names it)
    except OSError:
        sys.exit(CANNOT_START_EXIT)


if __name__ == "__main__":
    _become(int(sys.argv[1]), sys.argv[2:])
