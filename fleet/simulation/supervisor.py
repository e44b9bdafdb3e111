"""Starting the participants as processes, watching them, and leaving none behind."""

from __future__ import annotations

import multiprocessing as mp
import multiprocessing.connection as mpc
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from fleet.agents.process import uav_main
from fleet.coordinator.process import coordinator_main
from fleet.errors import BusError, FleetStoppedError, SecurityError
from fleet.model.types import COORDINATOR
from fleet.model.words import ClockMode
from fleet.node.join_info import JoinInfo
from fleet.printing import printable
from fleet.protocol.topics import issuer_name
from fleet.simulation.orphans import fork_server_pid, start_fork_server, tie_worker
from fleet.transport.zenoh_bus import LOST_SIMULATION_EXIT

PRELOAD = ["zenoh", "numpy", "msgspec", "fleet.agents.process", "fleet.coordinator.process"]
LEAN_RUNTIME = (
    "(rx: (handover: app), acc: (handover: app), app: (worker_threads: 1), "
    "tx: (handover: app), net: (handover: app))"
)
"""zenoh with one worker thread: a client needs no more. Not for routers: they may hang."""

GRACE_S = 2.0
BREATH_EVERY_S = 0.05
BREATH_S = 0.01
FORK_SERVER = "the fork server"
LOST_FORK_SERVER_EXIT = 255
"""What multiprocessing gives for the exit code of a process whose fork server has gone."""


class ProcessSupervisor:
    """The processes of a run that this simulation started."""

    def __init__(
        self, join_info: JoinInfo, numbers: list[int], uninterrupted: AbstractContextManager[object]
    ) -> None:
        """`whole` holds interrupts off while a process is there that is not yet known here."""
        self._join_info = join_info
        self._uninterrupted = uninterrupted
        self._numbers = numbers
        self._processes: dict[str, ForkServerProcess] = {}
        self._held: set[str] = set()
        self._holding = threading.Lock()
        self._killed: set[int | None] = set()
        self._ending = threading.Event()
        self._threads: list[threading.Thread] = []

    def start(
        self,
        on_death: Callable[[str, int], None],
        join_infos: Mapping[int, JoinInfo] | None = None,
    ) -> None:
        """Start everybody; `on_death(name, exit code)` is called, on a thread, for an early end.

        `join_infos` are of those who must know something else than the rest, by number.
        """
        # One BLAS thread each: a fleet is many processes already.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        start_fork_server(PRELOAD)
        for number in self._numbers:
            self._launch(number, (join_infos or {}).get(number, self._join_info))
        for work in (lambda: self._watch(on_death), self._breathe):
            thread = threading.Thread(target=work, daemon=True)
            thread.start()
            self._threads.append(thread)

    def pids(self) -> dict[str, int]:
        """Process IDs by name."""
        return {name: p.pid or 0 for name, p in self._processes.items()}

    def kill(self, number: int) -> None:
        """End a process at once, and wait until it has gone."""
        process = self._processes[issuer_name(number)]
        with self._holding:
            self._held.discard(issuer_name(number))
        self._killed.add(process.pid)
        process.kill()
        process.join()  # the guard lets a fork server go on that somebody has stopped

    def restart(self, number: int, join_info: JoinInfo) -> None:
        """Start a process that has been killed again."""
        self._launch(number, join_info)

    def hold(self, number: int) -> None:
        """Stop a process (SIGSTOP)."""
        with self._holding:
            self._held.add(issuer_name(number))
            self._signal(issuer_name(number), signal.SIGSTOP)

    def release(self, number: int) -> None:
        """Let it go on (SIGCONT)."""
        with self._holding:
            self._held.discard(issuer_name(number))
            self._signal(issuer_name(number), signal.SIGCONT)

    def frozen(self) -> frozenset[str]:
        """Processes that are stopped, but not by this simulation."""
        now = list(self._processes.items())  # at once: others may be starting
        found = {f"process {n}" for n, p in now if n not in self._held and _stopped(p.pid)}
        return frozenset(found | {FORK_SERVER} if _stopped(fork_server_pid()) else found)

    def states(self) -> dict[str, str]:
        """What the operating system says of each process, in a word or two."""
        return {name: _state(p.pid) for name, p in list(self._processes.items())}

    def let_go_on(self) -> None:
        """Continue what starts and ends the others, in case that somebody has stopped it."""
        _send(fork_server_pid(), signal.SIGCONT)

    def stop(self) -> None:
        """Wait for everybody to leave; end those that do not."""
        self._ending.set()
        self.let_go_on()
        for thread in self._threads:
            thread.join()
        for name in self._held:
            self._signal(name, signal.SIGCONT)
        self._await_all()
        for process in self._processes.values():
            if process.is_alive():
                process.kill()
        if not self._await_all():
            print(f"fleet: {FORK_SERVER} does not answer; ending it", file=sys.stderr)
            _send(fork_server_pid(), signal.SIGKILL)
            self._await_all()

    def _await_all(self) -> bool:
        """Give everybody a little time to end; whether all have."""
        deadline_s = time.monotonic() + GRACE_S
        for process in self._processes.values():
            process.join(max(0.0, deadline_s - time.monotonic()))
        return not any(process.is_alive() for process in self._processes.values())

    def _launch(self, number: int, join_info: JoinInfo) -> None:
        context = mp.get_context("forkserver")
        process = context.Process(target=_participant, args=(join_info, number), daemon=True)
        with self._uninterrupted:
            try:
                with _main_hidden():
                    process.start()
            except (EOFError, ConnectionError) as error:
                raise FleetStoppedError(f"{FORK_SERVER} has gone") from error
            self._processes[issuer_name(number)] = process

    def _signal(self, name: str, number: signal.Signals) -> None:
        _send(self._processes[name].pid, number)

    def _signal_held(self, number: signal.Signals) -> None:
        with self._holding:  # nobody may be let go in between
            for name in self._held:
                self._signal(name, number)

    def _watch(self, on_death: Callable[[str, int], None]) -> None:
        reported: set[int | None] = set()
        while not self._ending.is_set():
            now = list(self._processes.items())
            alive = {p.sentinel: n for n, p in now if p.pid not in reported}
            for sentinel in mpc.wait(list(alive), timeout=0.2) if alive else ():
                name = alive[int(sentinel)]  # type: ignore[arg-type]
                process = self._processes[name]
                reported.add(process.pid)
                if self._ending.is_set() or process.pid in self._killed:
                    continue
                process.join(1.0)
                on_death(name, process.exitcode if process.exitcode is not None else -1)
            if not alive:
                self._ending.wait(0.2)

    def _breathe(self) -> None:
        """Let stopped processes run for a moment now and then, in lockstep.

        They take their messages then, but do not step before the simulation continues them:
        otherwise the network would fill up and cut them off.
        """
        while not self._ending.wait(BREATH_EVERY_S):
            if self._join_info.clock != ClockMode.LOCKSTEP:
                continue
            self._signal_held(signal.SIGCONT)
            self._ending.wait(BREATH_S)
            self._signal_held(signal.SIGSTOP)


def _send(pid: int | None, number: signal.Signals) -> None:
    if pid:
        with suppress(ProcessLookupError):
            os.kill(pid, number)


STATES = {"R": "running", "S": "sleeping", "D": "blocked", "T": "stopped", "Z": "dead"}


def _stopped(pid: int | None) -> bool:
    """Whether a process is in the stopped state (known on Linux only)."""
    return _state(pid).startswith(STATES["T"])


def _state(pid: int | None) -> str:
    """State of a process, and what it waits for in the kernel (known on Linux only)."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
        letter = stat.rpartition(") ")[2][:1]
        where = Path(f"/proc/{pid}/wchan").read_text(encoding="ascii", errors="replace")
    except OSError:
        return "no state known"
    state = STATES.get(letter, letter)
    return state if where in ("", "0") else f"{state} in {where}"


def death_of(exit_code: int) -> str:
    """How a process ended, in words."""
    if exit_code == LOST_FORK_SERVER_EXIT:
        return f"{FORK_SERVER} has gone"
    if exit_code == LOST_SIMULATION_EXIT:
        return "it lost its link to the simulation"
    if exit_code >= 0:
        return f"exit code {exit_code}"
    try:
        return f"killed by {signal.Signals(-exit_code).name}"
    except ValueError:
        return f"killed by signal {-exit_code}"


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


def _participant(join_info: JoinInfo, number: int) -> None:
    """Entry of a started process: one line on an error."""
    tie_worker()
    os.environ.setdefault("ZENOH_RUNTIME", LEAN_RUNTIME)
    try:
        if number == COORDINATOR:
            coordinator_main(join_info)
        else:
            uav_main(join_info, number)
    except Exception as error:  # noqa: BLE001 (a resolver is user code)
        if os.environ.get("FLEET_DEBUG"):
            traceback.print_exc()
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
        expected = isinstance(error, BusError | SecurityError)
        what = str(error) if expected else f"{type(error).__name__}: {error}{where}"
        print(f"fleet: process {issuer_name(number)}: {printable(what)}", file=sys.stderr)
        sys.exit(1)
