"""What ties the processes of a command to it: none outlives it, however it ends.

A worker that runs sees the end of its command by a pipe. One that is stopped sees nothing: on Linux
the kernel kills the fork server when the command ends, and the workers when the fork server does,
stopped or not. (macOS has nothing of the kind: there a stopped worker ends once it is continued.)
"""

from __future__ import annotations

import ctypes
import multiprocessing as mp
import multiprocessing.connection as mpc
import os
import signal
import sys
import threading
from multiprocessing import forkserver

LOST_COMMAND_EXIT = 4
TIED_TO = "FLEET_TIED_TO"
"""Environment variable that tells the fork server, and nobody else, whom it must not outlive."""

_PR_SET_PDEATHSIG = 1
_TERMINAL = (signal.SIGINT, signal.SIGHUP)
"""Signals of a terminal, which go to its whole group; the command itself ends its workers."""


def start_fork_server(preload: list[str]) -> None:
    """Start the fork server, if there is none, tied to this process; it imports `preload` first."""
    mp.get_context("forkserver").set_forkserver_preload([__name__, *preload])
    # The kernel watches the thread that starts it: another than the main one may end before.
    main = threading.current_thread() is threading.main_thread()
    if main:
        os.environ[TIED_TO] = str(os.getpid())
    before = {n: signal.signal(n, signal.SIG_IGN) for n in _TERMINAL} if main else {}
    try:
        forkserver.ensure_running()
    finally:
        os.environ.pop(TIED_TO, None)
        for number, handler in before.items():
            signal.signal(number, handler)


def fork_server_pid() -> int | None:
    """The process that starts the others, if there is one."""
    pid: int | None = getattr(forkserver, "_forkserver")._forkserver_pid  # noqa: B009
    return pid


def tie_worker() -> None:
    """In a process of the fork server: end with the command, and leave its terminal's signals."""
    _ignore_terminal()
    _die_with_parent()
    parent = mp.parent_process()
    assert parent is not None

    def watch() -> None:
        mpc.wait([parent.sentinel])
        os._exit(LOST_COMMAND_EXIT)

    threading.Thread(target=watch, daemon=True).start()


def _ignore_terminal() -> None:
    for number in _TERMINAL:
        signal.signal(number, signal.SIG_IGN)


def _die_with_parent() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _tie_fork_server(command: int) -> None:
    _ignore_terminal()
    _die_with_parent()
    if os.getppid() != command:  # it has ended meanwhile
        os._exit(LOST_COMMAND_EXIT)


# The fork server has no other hook than the import of what it preloads.
if _command := os.environ.pop(TIED_TO, ""):
    _tie_fork_server(int(_command))
