"""No process outlives the command that started it, however that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import Cli
from tests.faults.test_process_faults import state_of
from tests.simulation.test_simulation import LONG, flying, participants, until

STARTING = """
import contextlib, threading
from fleet.node.join_info import JoinInfo
from fleet.simulation.supervisor import ProcessSupervisor
from fleet.config.loading import read_scenario

scenario = read_scenario("head_on").scenario
join_info = JoinInfo("tcp/127.0.0.1:1", "run", "lockstep", scenario)
supervisor = ProcessSupervisor(join_info, [0, 1, 2], contextlib.nullcontext())
supervisor.start(lambda *_: None)
print(*supervisor.pids().values(), flush=True)
threading.Event().wait()
"""
"""A simulation whose processes look for a router that is not there, which they do for a minute."""


def fork_server(cli: Cli, run: subprocess.Popen[str]) -> int:
    """The process that has made the participants of a run."""
    stat = Path(f"/proc/{participants(cli, run)[0]}/stat").read_text(encoding="ascii")
    return int(stat.rpartition(")")[2].split()[1])


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_stopped_process_does_not_outlive_a_killed_range(
    cli: Cli, tmp_path: Path, clock: str
) -> None:
    log = tmp_path / "run.mcap"
    faults = ("--clock", clock, "--pause", "1@0.2s")
    run = cli.start("run", "head_on", "--duration", LONG, *faults, "--out", str(log))
    until(lambda: flying(cli, run, log, size=1))
    until(lambda: state_of(participants(cli, run)[1]) == "T")
    os.kill(run.pid, signal.SIGKILL)
    run.wait(timeout=30)
    until(lambda: cli.members(run) == [], 10)


def test_processes_that_are_starting_do_not_outlive_a_killed_range(cli: Cli) -> None:
    started = cli.command(sys.executable, "-c", STARTING)
    assert started.stdout is not None
    pids = [int(p) for p in started.stdout.readline().split()]
    assert set(pids) < set(cli.members(started))
    os.kill(started.pid, signal.SIGKILL)
    started.wait(timeout=30)
    until(lambda: cli.members(started) == [], 10)


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux does it")
def test_a_stopped_fork_server_does_not_outlive_a_killed_range(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    run = cli.start("run", "head_on", "--duration", LONG, "--out", str(log))
    until(lambda: flying(cli, run, log))
    os.kill(fork_server(cli, run), signal.SIGSTOP)
    os.kill(run.pid, signal.SIGKILL)
    run.wait(timeout=30)
    until(lambda: cli.members(run) == [], 10)


@pytest.mark.parametrize("sent", [signal.SIGSTOP, signal.SIGKILL])
def test_a_run_whose_fork_server_is_stopped_or_killed_ends_with_one_line(
    cli: Cli, tmp_path: Path, sent: signal.Signals
) -> None:
    log = tmp_path / "run.mcap"
    run = cli.start("run", "head_on", "--duration", LONG, "--out", str(log))
    until(lambda: flying(cli, run, log))
    os.kill(fork_server(cli, run), sent)
    _, err = run.communicate(timeout=20)
    assert run.returncode == 1
    assert err.count("\n") == 1
    assert "INVALID" in err
    assert "the fork server" in err
    until(lambda: cli.members(run) == [], 10)


def test_a_restart_does_not_hang_on_a_stopped_fork_server(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    more = ("--speed", "4", "--kill", "2@4s+1s")
    run = cli.start("run", "head_on", "--duration", "80", *more, "--out", str(log))
    until(lambda: flying(cli, run, log, size=1))
    os.kill(fork_server(cli, run), signal.SIGSTOP)
    _, err = run.communicate(timeout=20)
    assert "the fork server stopped answering" in err
    until(lambda: cli.members(run) == [], 10)


def test_the_workers_of_a_killed_campaign_end(cli: Cli) -> None:
    fuzz = cli.start("fuzz", "--runs", "100000", "--jobs", "2")
    until(lambda: len(participants(cli, fuzz)) == 2)
    os.kill(fuzz.pid, signal.SIGKILL)
    fuzz.wait(timeout=30)
    until(lambda: cli.members(fuzz) == [], 10)
