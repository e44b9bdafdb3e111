"""One run whose roles are spread over hosts, started as a user would start them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fleet.errors import LogError
from fleet.log.reader import read
from fleet.protocol.topics import issuer_of, suffix_of
from tests.hosts.namespaces import Hosts

ROUTER_HOST = 0
PORT = 7447
WAIT_S = 120.0


class SpreadFleet:
    """The router and the simulation on the first host, coordinator and UAVs on the others in turn.

    `ended_s` is when each process ended, by name, on the clock of `time.monotonic`.
    """

    def __init__(
        self,
        hosts: Hosts,
        folder: Path,
        uavs: int,
        others: Sequence[int],
        *,
        linked: bool = False,
    ) -> None:
        """`others` are the hosts of the UAVs; the coordinator is on the first of them.

        If `linked` these have routers of their own, which are linked to that of the first host.
        """
        self.hosts = hosts
        self.where = self.endpoint(ROUTER_HOST)
        self.ended_s: dict[str, float] = {}
        self.said: dict[str, str] = {}
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self.log = folder / "run.mcap"
        self._threads: list[threading.Thread] = []
        self._homes = {str(n + 1): others[n * len(others) // uavs] for n in range(uavs)}
        self._homes["coordinator"] = others[0]
        self.router = self.start_router()
        self._nearest = {host: host if linked else ROUTER_HOST for host in others}
        for host in {*self._nearest.values()} - {ROUTER_HOST}:
            self.start_router(host, "--link", self.where)

    def on(self, host: int) -> set[str]:
        """Who is on a host."""
        return {name for name, home in self._homes.items() if home == host}

    def start_router(self, host: int = ROUTER_HOST, *options: str) -> subprocess.Popen[str]:
        """Start the router of a host, or another one in its place."""
        router = self.hosts.start(host, "router", "--listen", self.endpoint(host), *options)
        assert router.stderr is not None
        told = router.stderr.readline()
        assert "listening" in told, told
        self._follow(f"router {host}", router)
        return router

    def endpoint(self, host: int) -> str:
        """Where the router of a host is."""
        return f"tcp/{self.hosts.address(host)}:{PORT}"

    def finish(self) -> None:
        """All processes have been ended: take what they said."""
        for thread in self._threads:
            thread.join()

    def fly(self, scenario: Sequence[str], *options: str) -> None:
        """Start the run and everybody who is to join."""
        words = ("run", *scenario, *options, "--connect", self.where, "--external", "--json")
        run = self.hosts.start(ROUTER_HOST, *words, "--force", "--out", str(self.log))
        self.simulation = run
        self._follow("run", run)
        for name in self._homes:
            self.join(name)

    def join(self, name: str) -> None:
        """Start one participant on its host."""
        role = ("coordinator",) if name == "coordinator" else ("uav", name)
        home = self._homes[name]
        where = self.endpoint(self._nearest[home])
        self.processes[name] = self.hosts.start(home, *role, "--connect", where)
        self._follow(name, self.processes[name])

    def _follow(self, name: str, process: subprocess.Popen[str]) -> None:
        def follow() -> None:
            out, err = process.communicate()
            self.said[name] = out + err if name != "run" else out
            self.ended_s[name] = time.monotonic()

        thread = threading.Thread(target=follow, daemon=True, name=name)
        thread.start()
        self._threads.append(thread)

    def await_flight(self, seconds: float) -> None:
        """Until the log has so much simulated time of somebody."""
        deadline_s, pause = time.monotonic() + WAIT_S, threading.Event()
        while self.flown_s() < seconds:
            assert "run" not in self.ended_s, self.said
            assert time.monotonic() < deadline_s, self.said
            pause.wait(0.1)

    def flown_s(self) -> float:
        """Up to which simulated time the log goes by now."""
        try:
            return max((sent_ns for _, sent_ns in self.logged()), default=0) / 1e9
        except LogError:
            return 0.0

    def logged(self) -> list[tuple[str, int]]:
        """Issuers of true states, and when these were sent."""
        records = read(self.log)
        return [(issuer_of(r.topic), r.sent_ns) for r in records if suffix_of(r.topic) == "truth"]

    def result(self, within_s: float = WAIT_S) -> dict[str, Any]:
        """Wait for the end of the run; what it came to."""
        self.await_end("run", within_s=within_s)
        found: dict[str, Any] = json.loads(self.said["run"])
        return found

    def await_end(self, *names: str, within_s: float) -> None:
        """Wait until these processes have ended."""
        for thread in self._threads:
            if thread.name in names:
                thread.join(within_s)
                assert not thread.is_alive(), f"{thread.name} is still there"

    @staticmethod
    def kill(process: subprocess.Popen[str]) -> None:
        """At once, as by a power cut of its program."""
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
