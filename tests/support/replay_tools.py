"""What tests of `fleet replay` share: logs, an independent subscriber, a terminal."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import zenoh

from fleet.config.loading import read_scenario
from fleet.log.reader import Record, read
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.conftest import Cli

S = 1_000_000_000
"""A second in ns."""


def log_of(*moments: tuple[float, str]) -> list[Record]:
    """A log with a message for each log time in s and topic."""
    return [Record(t, b"%d" % n, n, 0, round(s * S)) for n, (s, t) in enumerate(moments)]


def until(condition: Callable[[], bool]) -> None:
    """Wait for a condition that must come; the time-out is that of a broken test."""
    deadline, pause = time.monotonic() + 60, threading.Event()
    while not condition():
        assert time.monotonic() < deadline
        pause.wait(0.01)


def client(endpoint: str) -> zenoh.Session:
    """A client with the defaults of zenoh, but for where it connects."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


class Ear:
    """A zenoh client that keeps what it hears under a key expression, in order."""

    def __init__(self, endpoint: str, expression: str, slow_s: float = 0.0) -> None:
        self._slow_s = 0.0
        self.heard: list[tuple[str, bytes]] = []
        self._session = client(endpoint)
        # Direct: a slow callback holds the session up, as a subscriber that cannot keep up does.
        callback = zenoh.handlers.Callback(self._hear, indirect=not slow_s)
        self._subscriber = self._session.declare_subscriber(expression, callback)
        self._await_declaration(endpoint, expression.replace("**", "ping"))
        self._slow_s = slow_s

    def _hear(self, sample: zenoh.Sample) -> None:
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes()))
        time.sleep(self._slow_s)

    def _await_declaration(self, endpoint: str, key: str) -> None:
        """The router has the subscription once somebody else's message comes through it."""
        with client(endpoint) as other:

            def came() -> bool:
                other.put(key, b"ping", congestion_control=zenoh.CongestionControl.BLOCK)
                return bool(self.heard)

            until(came)
            other.put(key, b"last", congestion_control=zenoh.CongestionControl.BLOCK)
            until(lambda: self.heard[-1][1] == b"last")
        self.heard.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()
        self._session.close()


def logged(path: Path, name: str, duration_s: str = "3") -> str:
    """Write a short log; the run's name."""
    options = RunOptions(
        read_scenario(name, [f"duration_s={duration_s}"]).scenario, bus="memory", out=path
    )
    run_fleet(options, lambda _: None)
    return options.run


def expected(log: Path, run: str) -> list[tuple[str, bytes]]:
    return [(f"fleet/{run}/{r.topic}", r.payload) for r in read(log)]


def told(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert done.returncode == 0, done.stderr
    parsed: dict[str, Any] = json.loads(done.stdout)
    return parsed


class Terminal:
    """`fleet replay` with a terminal of its own as its standard input."""

    def __init__(self, cli: Cli, *arguments: str) -> None:
        self._near, self._far = pty.openpty()
        self.before = termios.tcgetattr(self._far)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "fleet", "replay", *arguments],
            cwd=cli.folder,
            stdin=self._far,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def endpoint(self) -> str:
        """Where it listens, once the keys work."""
        words = self.line().split()
        assert "paused; keys" in self.line()
        return words[words.index("on") + 1].rstrip(":")

    def line(self) -> str:
        assert self.process.stderr is not None
        return self.process.stderr.readline()

    def press(self, keys: bytes) -> None:
        os.write(self._near, keys)

    def settings(self) -> list[Any]:
        return termios.tcgetattr(self._far)

    def ended(self) -> bool:
        return self.process.poll() is not None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()
        self.process.communicate()
        os.close(self._near)
        os.close(self._far)
