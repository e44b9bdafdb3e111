"""A terminal that is closed (SIGHUP) ends every command as Ctrl-C does."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from fleet.log.reader import summarise
from fleet.transport.run_search import find_plan
from fleet.transport.zenoh_bus import open_client_bus
from tests.conftest import Cli
from tests.simulation.test_simulation import LONG, flying, participants, until
from tests.support.replay_tools import logged

ON_TERMINAL = 'terminal=$1; shift; exec "$@" <"$terminal" >"$terminal" 2>&1'
"""What leads a session and opens a terminal has it for its own."""


class Terminal:
    """One end of a terminal; closing it hangs up."""

    def __init__(self) -> None:
        self._ours, self._theirs = pty.openpty()
        os.set_blocking(self._ours, False)
        self.name = os.ttyname(self._theirs)

    def read(self) -> None:
        """Show what is written to it: nowhere."""
        with suppress(BlockingIOError, OSError):
            while os.read(self._ours, 4096):
                pass

    def close(self) -> None:
        """Hang up."""
        for end in (self._ours, self._theirs):
            with suppress(OSError):
                os.close(end)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    opened = Terminal()
    yield opened
    opened.close()


def hung_up(process: subprocess.Popen[str]) -> tuple[int, list[str]]:
    """Its exit code and what it says on standard error, when its group is told of the end."""
    os.killpg(process.pid, signal.SIGHUP)
    _, err = process.communicate(timeout=30)
    return process.returncode, err.splitlines()


def test_a_run_whose_terminal_is_closed_leaves_a_whole_log_and_no_process(
    cli: Cli, tmp_path: Path, terminal: Terminal
) -> None:
    log = tmp_path / "run.mcap"
    fleet = (sys.executable, "-m", "fleet", "run", "head_on", "--duration", LONG, "--out", log)
    run = cli.command("sh", "-c", ON_TERMINAL, "sh", terminal.name, *map(str, fleet))

    def begun() -> bool:
        terminal.read()
        return flying(cli, run, log)

    until(begun)
    terminal.close()
    assert run.wait(timeout=30) == 130
    until(lambda: cli.members(run) == [])
    assert summarise(log).complete
    result = summarise(log).metadata["result"]
    assert (result["status"], "SIGHUP" in result["why"]) == ("interrupted", True)


def test_a_run_that_is_to_outlive_its_terminal_does(cli: Cli, tmp_path: Path) -> None:
    """As under nohup."""
    log = tmp_path / "run.mcap"
    fleet = (sys.executable, "-m", "fleet", "run", "head_on", "--duration", "20", "--out", log)
    deaf = 'trap "" HUP; exec "$@" --speed 10'
    run = cli.command("sh", "-c", deaf, "sh", *map(str, fleet))
    until(lambda: flying(cli, run, log, size=1))
    assert hung_up(run)[0] == 0


def test_roles_by_hand(cli: Cli) -> None:
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    endpoint = router.stderr.readline().split()[-1]
    assert router.stderr.readline().startswith("fleet: the bus is open")
    run = cli.start("run", "head_on", "--connect", endpoint, "--external")
    name, _ = find_plan(endpoint, "*", 30.0)
    roles = {"1": ("uav", "1"), "coordinator": ("coordinator",)}
    started = [cli.start(*role, "--connect", endpoint) for role in roles.values()]
    with open_client_bus(name, "watcher", endpoint) as watcher:
        until(lambda: all(watcher.is_alive(role) for role in roles))
    for process in started:
        assert hung_up(process) == (130, ["fleet: interrupted"])
    _, err = run.communicate(timeout=30)
    assert "stopped answering" in err
    assert hung_up(router) == (0, [])


def test_a_replay(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    logged(log, "head_on", "5")
    replay = cli.start("replay", str(log), "--loop")
    assert replay.stderr is not None
    assert "replaying as run" in replay.stderr.readline()
    code, said = hung_up(replay)
    assert (code, len(said)) == (130, 1)
    assert said[0].startswith("fleet: interrupted")  # before or after the first message


def test_a_campaign(cli: Cli) -> None:
    fuzz = cli.start("fuzz", "--runs", "100000", "--jobs", "2")
    until(lambda: len(participants(cli, fuzz)) == 2)
    code, said = hung_up(fuzz)
    assert (code, len(said)) == (130, 1)
    assert said[0].startswith("fleet: interrupted; go on with --seed")
    until(lambda: cli.members(fuzz) == [])
