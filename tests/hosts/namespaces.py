"""Hosts of one machine: network namespaces on one switch, whose ports can be cut and healed.

A port that is cut passes nothing and tells nobody, as a cable that is pulled somewhere behind the
next switch: that is what `bridge link set ... state 0` does, exactly and at once.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Self

_numbers = count(1)
BLOCKED, FORWARDING = "0", "3"
ATTEMPTS = 5


def unable() -> str:
    """Why namespaces cannot be had here; empty if they can."""
    if sys.platform != "linux" or not (shutil.which("ip") and shutil.which("bridge")):
        return "needs Linux with iproute2 (ip, bridge)"
    if os.geteuid() != 0:
        return "needs root, for network namespaces"
    probe = f"fleet-{os.getpid()}-probe"
    if _ip("netns", "add", probe, check=False).returncode != 0:
        return "network namespaces are not permitted here"
    _ip("netns", "delete", probe)
    return ""


def _ip(*words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    return subprocess.run(("ip", *words), check=check, capture_output=True, text=True)


def _delete(namespace: str) -> None:
    """Take a namespace away; one that is being left may be busy for a moment."""
    for _ in range(20):
        if _ip("netns", "delete", namespace, check=False).returncode == 0:
            return
        time.sleep(0.1)


class Hosts:
    """So many hosts, 10.77.0.1 and on, and a switch; a context that leaves nothing behind."""

    def __init__(self, number: int, folder: Path) -> None:
        self._folder = folder
        self._prefix = f"fleet-{os.getpid()}-{next(_numbers)}"
        self._switch = f"{self._prefix}-switch"
        self._count = number
        self.started: list[subprocess.Popen[str]] = []

    def __enter__(self) -> Self:
        """Set everything up."""
        try:
            self._set_up()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def _set_up(self) -> None:
        _ip("netns", "add", self._switch)
        self._in_switch("ip", "link", "add", "br0", "type", "bridge")
        self._in_switch("ip", "link", "set", "br0", "up")
        for host in range(self._count):
            name = self.namespace(host)
            _ip("netns", "add", name)
            ends = ("eth0", "netns", name, "type", "veth", "peer", "name", self._port(host))
            _ip("link", "add", *ends, "netns", self._switch)
            self._in_switch("ip", "link", "set", self._port(host), "master", "br0", "up")
            for words in (
                ("link", "set", "lo", "up"),
                ("addr", "add", f"{self.address(host)}/24", "dev", "eth0"),
                ("link", "set", "eth0", "up"),
            ):
                _ip("-n", name, *words)
            self.heal(host)

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _value: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        """End all processes, and take everything away again."""
        for process in self.started:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        for name in (*map(self.namespace, range(self._count)), self._switch):
            _delete(name)

    def namespace(self, host: int) -> str:
        """Its name."""
        return f"{self._prefix}-{host}"

    @staticmethod
    def address(host: int) -> str:
        """Where it is."""
        return f"10.77.0.{host + 1}"

    @staticmethod
    def _port(host: int) -> str:
        return f"port{host}"

    def cut(self, *hosts: int) -> None:
        """From now on nothing reaches these hosts, and nothing comes from them."""
        for host in hosts:
            self._state(host, BLOCKED)

    def heal(self, *hosts: int) -> None:
        """It does again."""
        for host in hosts:
            self._state(host, FORWARDING)

    def _state(self, host: int, state: str) -> None:
        self._in_switch("bridge", "link", "set", "dev", self._port(host), "state", state)

    def _in_switch(self, *words: str) -> None:
        """Run a program in the switch; entering it fails where namespaces go at that moment."""
        for _ in range(ATTEMPTS - 1):
            if _ip("netns", "exec", self._switch, *words, check=False).returncode == 0:
                return
            time.sleep(0.2)
        _ip("netns", "exec", self._switch, *words)

    def start(self, host: int, *arguments: str) -> subprocess.Popen[str]:
        """Start `fleet` on a host."""
        return self.command(host, sys.executable, "-m", "fleet", *arguments)

    def command(self, host: int, *words: str) -> subprocess.Popen[str]:
        """Start a program on a host."""
        process = subprocess.Popen(
            ("ip", "netns", "exec", self.namespace(host), *words),
            cwd=self._folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.started.append(process)
        return process
