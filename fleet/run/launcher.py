"""Starting the participants as processes, watching them, and leaving none behind."""

from __future__ import annotations

import ctypes
import multiprocessing as mp
import multiprocessing.connection as mpc
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.context import ForkServerProcess

from agents.process import uav_main
from coordinator.process import coordinator_main
from fleet.comms.keys import issuer_name
from fleet.comms.messages import COORDINATOR
from fleet.comms.participant import Membership

PRELOAD = ["zenoh", "numpy", "msgspec", "agents.process", "coordinator.process"]
LEAN_RUNTIME = (
    "(rx: (handover: app), acc: (handover: app), app: (worker_threads: 1), "
    "tx: (handover: app), net: (handover: app))"
)
"""zenoh with one worker thread: a client needs no more. Not for routers: they may hang."""

GRACE_S = 2.0
_PR_SET_PDEATHSIG = 1


class Crew:
    """The processes of a run that this range started."""

    def __init__(self, membership: Membership, uav_ids: list[int]) -> None:
        self._membership = membership
        self._ids = [COORDINATOR, *uav_ids]
        self._processes: dict[str, ForkServerProcess] = {}
        self._ending = threading.Event()
        self._watcher: threading.Thread | None = None

    def start(self, on_death: Callable[[str, int], None]) -> None:
        """Start everybody; `on_death(name, exit code)` is called, on a thread, for an early end."""
        # One BLAS thread each: a fleet is many processes already.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        context = mp.get_context("forkserver")
        context.set_forkserver_preload(PRELOAD)
        _start_fork_server()
        with _main_hidden():
            for number in self._ids:
                process = context.Process(
                    target=_participant, args=(self._membership, number), daemon=True
                )
                process.start()
                self._processes[issuer_name(number)] = process
        self._watcher = threading.Thread(target=self._watch, args=(on_death,), daemon=True)
        self._watcher.start()

    def pids(self) -> dict[str, int]:
        """Process IDs by name."""
        return {name: p.pid or 0 for name, p in self._processes.items()}

    def stop(self) -> None:
        """Wait for everybody to leave; end those that do not."""
        self._ending.set()
        deadline_s = time.monotonic() + GRACE_S
        for process in self._processes.values():
            process.join(max(0.0, deadline_s - time.monotonic()))
        for process in self._processes.values():
            if process.is_alive():
                process.kill()
        for process in self._processes.values():
            process.join()

    def _watch(self, on_death: Callable[[str, int], None]) -> None:
        names = {p.sentinel: name for name, p in self._processes.items()}
        while names and not self._ending.is_set():
            for sentinel in mpc.wait(list(names), timeout=0.5):
                name = names.pop(int(sentinel))  # type: ignore[arg-type]
                if self._ending.is_set():
                    return
                process = self._processes[name]
                process.join(1.0)
                on_death(name, process.exitcode if process.exitcode is not None else -1)


def death_of(exit_code: int) -> str:
    """How a process ended, in words."""
    if exit_code >= 0:
        return f"exit code {exit_code}"
    try:
        return f"killed by {signal.Signals(-exit_code).name}"
    except ValueError:
        return f"killed by signal {-exit_code}"


def _start_fork_server() -> None:
    """Start it deaf to Ctrl-C, which goes to the whole terminal group while it still imports."""
    main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if main else None
    try:
        forkserver.ensure_running()
    finally:
        if main:
            signal.signal(signal.SIGINT, before)


@contextmanager
def _main_hidden() -> Iterator[None]:
    """Keep children from importing the program that starts them: they need one function of ours.

    multiprocessing would import it, with all of its command line, into every one of them.
    """
    main = sys.modules["__main__"].__dict__
    hidden = {name: main.get(name) for name in ("__file__", "__spec__")}
    main.update(dict.fromkeys(hidden))
    try:
        yield
    finally:
        main.update(hidden)


def _participant(membership: Membership, number: int) -> None:
    """Entry of a started process: quiet on Ctrl-C (the range ends it), one line on an error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("ZENOH_RUNTIME", LEAN_RUNTIME)
    _die_with_parent()
    try:
        if number == COORDINATOR:
            coordinator_main(membership)
        else:
            uav_main(membership, number)
    except Exception as error:  # noqa: BLE001 (a resolver is user code)
        if os.environ.get("FLEET_DEBUG"):
            traceback.print_exc()
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
        name = issuer_name(number)
        print(f"fleet: process {name}: {type(error).__name__}: {error}{where}", file=sys.stderr)
        sys.exit(1)


def _die_with_parent() -> None:
    """Linux: also a stopped or hung child ends when the range's fork server does."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
