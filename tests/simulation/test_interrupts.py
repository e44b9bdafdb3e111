"""Ctrl-C ends a run between two records, never inside one."""

from __future__ import annotations

import shlex
import signal
import subprocess
import sys
from multiprocessing.context import ForkServerProcess

import pytest

from fleet.cli import main
from fleet.config.loading import read_scenario
from fleet.node.join_info import JoinInfo
from fleet.simulation.interrupts import Interrupts
from fleet.simulation.supervisor import ProcessSupervisor


def test_a_signal_outside_interrupts_at_once() -> None:
    interrupts = Interrupts()
    interrupts.install()
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    finally:
        interrupts.restore()


def test_a_signal_inside_waits_for_the_end_of_the_section() -> None:
    interrupts, done = Interrupts(), []
    interrupts.install()
    try:
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012, SIM117 (the section is tested)
            with interrupts:
                signal.raise_signal(signal.SIGINT)
                done.append("whole")
        with interrupts:
            done.append("next")
    finally:
        interrupts.restore()
    assert done == ["whole", "next"]


def test_signals_are_given_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    interrupts = Interrupts()
    interrupts.install()
    assert signal.getsignal(signal.SIGTERM) != before
    interrupts.restore()
    assert signal.getsignal(signal.SIGTERM) == before


def test_a_process_that_is_just_being_started_is_known_when_the_run_is_interrupted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else nobody would end it."""

    def start(_: ForkServerProcess) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ForkServerProcess, "start", start)
    scenario = read_scenario("head_on").scenario
    interrupts = Interrupts()
    supervisor = ProcessSupervisor(JoinInfo("", "run", "lockstep", scenario), [1], interrupts)
    interrupts.install()
    try:
        with pytest.raises(KeyboardInterrupt):
            supervisor.restart(1, JoinInfo("", "run", "lockstep", scenario))
    finally:
        interrupts.restore()
    assert list(supervisor.pids()) == ["1"]


def test_ctrl_c_is_one_line_while_the_command_line_is_being_imported() -> None:
    program = (
        "import sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'fleet.cli.run':\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Finder())\n"
        "from fleet.entry import start\n"
        "start()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "fleet: interrupted\n")


def test_ctrl_c_is_one_line_in_a_command_that_says_nothing_itself(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("fleet.cli.info.summarise", interrupted)
    monkeypatch.setattr(sys, "argv", ["fleet", "info", "x.mcap"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert (ended.value.code, *capsys.readouterr()) == (130, "", "fleet: interrupted\n")


def test_a_closed_standard_output_is_no_error() -> None:
    command = f"{shlex.quote(sys.executable)} -m fleet scenarios >&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
