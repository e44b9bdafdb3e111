"""What tests share: scenarios, runs in memory, and the command line as a process."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.protocol.messages import Message, Truth
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from fleet.transport.interface import ReceivedMessage

settings.register_profile("fleet", deadline=None)  # a busy machine makes no test fail
settings.load_profile("fleet")


class KeepingRecorder(RunRecorder):
    """A run recorder that keeps every message too."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario, None)
        self.scenario = scenario
        self.kept: list[Message] = []

    def note(self, item: ReceivedMessage, log_ns: int) -> None:
        self.kept.append(item[2])
        super().note(item, log_ns)


def truths(run: KeepingRecorder, uav: int) -> list[Truth]:
    """The true states of one UAV."""
    return [m for m in run.kept if isinstance(m, Truth) and m.id == uav]


def kept_run(scenario: Scenario) -> KeepingRecorder:
    """Run a scenario in memory and keep all that was said."""
    run_recorder = KeepingRecorder(scenario)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return run_recorder


def fly(name: str, *overrides: str) -> KeepingRecorder:
    """The same of a packaged scenario."""
    return kept_run(read_scenario(name, overrides).scenario)


class Cli:
    """Runs `fleet` as a process of its own group, which is gone when the test is."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._started: list[subprocess.Popen[str]] = []

    def start(self, *arguments: str, **environment: str) -> subprocess.Popen[str]:
        """Start it."""
        return self.command(sys.executable, "-m", "fleet", *arguments, **environment)

    def command(self, *words: str, **environment: str) -> subprocess.Popen[str]:
        """Start another program."""
        process = subprocess.Popen(
            words,
            cwd=self.folder,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._started.append(process)
        return process

    def run(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run it to its end."""
        process = self.start(*arguments, **environment)
        out, err = process.communicate(timeout=120)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def members(self, process: subprocess.Popen[str]) -> list[int]:
        """IDs of all processes that a started command has left in its session."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                with contextlib.suppress(OSError, IndexError):
                    fields = (entry / "stat").read_text().rpartition(")")[2].split()
                    if int(fields[3]) == process.pid and fields[0] != "Z":
                        found.append(int(entry.name))
        return sorted(found)

    def end(self) -> None:
        """End what is left."""
        for process in self._started:
            for pid in self.members(process):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            process.kill()
            process.communicate()


@pytest.fixture
def cli(tmp_path: Path) -> Iterator[Cli]:
    """The command line, in an empty folder."""
    command = Cli(tmp_path)
    yield command
    command.end()
