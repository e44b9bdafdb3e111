"""The watchdog: aborts a run, by a message to its simulation, when a participant dies or hangs."""

from __future__ import annotations

import threading
import time
from collections.abc import Collection
from dataclasses import dataclass

from fleet.protocol.topics import ABORT, issuer_number
from fleet.simulation.join_wait import JoinWait
from fleet.simulation.outages import OutageTracker
from fleet.simulation.stall import Stall, examine, silent_among
from fleet.simulation.supervisor import ProcessSupervisor, death_of
from fleet.simulation.tick_barrier import TickBarrier
from fleet.transport.zenoh_bus import Bus

DEATH_NOTICE_S = 1.0
"""How long a vanished token waits for the operating system to say how its process ended."""

ROUTER_TIMEOUT_S = 2.0


def lost_words(gone: Collection[str], silent: Collection[str]) -> str:
    """Who is lost, as in `processes 3, 4 stopped answering: 3, 4 have left the router`."""
    names = sorted(silent, key=_in_order)
    what = f"process{'es' if len(names) > 1 else ''} {', '.join(names)} stopped answering"
    left = sorted(gone, key=_in_order)
    if left == names:
        return f"{what}: ended, or cut off from the router"
    return f"{what}: {', '.join(left)} ended, or cut off from the router; the rest is silent"


def _in_order(name: str) -> tuple[bool, int, str]:
    return (True, int(name), "") if name.isdigit() else (False, 0, name)


@dataclass(frozen=True)
class TokenLimits:
    """In realtime nobody's absence ends the run: it is told to `outages`.

    The router may be away for `router_s`.
    """

    outages: OutageTracker
    router_s: float


class Watchdog:
    """Aborts the run, by a message to the simulation itself, when a participant dies or hangs."""

    def __init__(
        self,
        bus: Bus,
        barrier: TickBarrier,
        stall_s: float,
        supervisor: ProcessSupervisor,
        limits: TokenLimits | None = None,
    ) -> None:
        """Without `limits` whoever leaves, or the router, ends the run."""
        self._barrier = barrier
        self._bus = bus
        self._stall_s = stall_s
        self._supervisor = supervisor
        self._limits = limits
        self._join_wait: JoinWait | None = None
        self.stall: Stall | None = None
        self._gone: set[str] = set()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch_progress, daemon=True)

    def start(self, join_wait: JoinWait | None = None) -> None:
        """Begin to watch; by liveliness tokens those that others start, and how long they take."""
        self._join_wait = join_wait
        if join_wait:
            self._bus.watch(self._lost, self._came)
        self._thread.start()

    def end(self) -> None:
        """Deaths from now on are part of the ending."""
        self._ended.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join()

    def died(self, name: str, exit_code: int) -> None:
        """A process that this simulation started has ended."""
        self._abort(f"process {name} ended early ({death_of(exit_code)})")

    def _lost(self, name: str) -> None:
        # On a thread of zenoh's: leave the wait to another one. Others of its host may follow.
        if name not in self._barrier.names or self._ended.is_set():
            return
        if self._limits:
            if self._bus.has_router():  # else all seem to have left
                self._limits.outages.leave(issuer_number(name))
            return
        first = not self._gone
        self._gone.add(name)
        if first:
            timer = threading.Timer(DEATH_NOTICE_S, self._tell_lost)
            timer.daemon = True
            timer.start()

    def _came(self, name: str) -> None:
        if self._limits and name in self._barrier.names:
            self._limits.outages.come(issuer_number(name))

    def _tell_lost(self) -> None:
        """Name all that are lost: who has left the router, and who does not answer."""
        barrier = self._barrier
        here = barrier.names - (barrier.waiting if barrier.joining else set())
        silent = silent_among(self._bus, here) if self._bus.has_router() else set()
        if silent == here:
            silent = set()  # it is the question that nobody heard
        self._abort(lost_words(self._gone, silent | self._gone))

    def _watch_progress(self) -> None:
        before: frozenset[str] = frozenset()
        routed_s, away_s = time.monotonic(), self._limits.router_s if self._limits else 0.0
        while not self._ended.wait(0.5):
            if self._bus.has_router():
                routed_s = time.monotonic()
            elif time.monotonic() - routed_s > away_s:
                self._abort("the zenoh router has gone")
                return
            frozen = self._supervisor.frozen()
            for who in sorted(frozen & before):
                self._abort(f"{who} stopped answering (it has been stopped)")
                self._supervisor.let_go_on()
                return
            before = frozen
            why = self._overdue()
            if why:
                self._abort(why)
                return

    def _overdue(self) -> str:
        """Why there is no more waiting; empty as long as there is."""
        barrier = self._barrier
        if self._join_wait and barrier.joining:
            return self._join_wait.over()
        late = barrier.busy and time.monotonic() - barrier.moved_s > self._stall_s
        return self._explain() if late else ""

    def _explain(self) -> str:
        """Why nothing happens any more."""
        barrier = self._barrier
        if self._bus.router and not self._bus.router_answers(ROUTER_TIMEOUT_S):
            return f"the zenoh router at {self._bus.router} does not answer: its link is silent"
        who = ", ".join(sorted(barrier.waiting)) or "a message on its way"
        self.stall = examine(
            self._bus, set(barrier.waiting), list(barrier.items), self._supervisor.states()
        )
        return f"nothing from {who} for {self._stall_s:g} s: {self.stall.line()}"

    def _abort(self, why: str) -> None:
        if self._ended.is_set():
            return
        if not self._bus.has_router():  # everything else follows from that
            why = f"the zenoh router at {self._bus.router} has gone"
        self._barrier.words.say(ABORT, why.encode())
        self._bus.put(ABORT, why.encode())
