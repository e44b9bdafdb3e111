"""A run that is watched: at which speed it flies, and that it alone says how it ended."""

from __future__ import annotations

import signal
from contextlib import nullcontext
from pathlib import Path

import pytest

from fleet.cli import application, run
from fleet.errors import BusError
from fleet.simulation.simulation import RunOptions, RunOutcome
from tests.conftest import Cli
from tests.support.replay_tools import until


@pytest.mark.parametrize(
    ("given", "flown"),
    [((), 1.0), (("--speed", "0"), 0.0), (("--speed", "3"), 3.0), (("--clock", "realtime"), 0.0)],
)
@pytest.mark.parametrize("shown", [("--live",), ("--foxglove",)])
def test_a_watched_run_flies_at_real_time_unless_a_speed_is_given(
    given: tuple[str, ...],
    flown: float,
    shown: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    speeds = []

    def fly(options: RunOptions, _: object) -> RunOutcome:
        speeds.append(options.speed)
        raise BusError("enough")

    monkeypatch.setattr(run, "run_fleet", fly)
    monkeypatch.setattr(run, "shown_beside", lambda *_, **__: nullcontext())
    words = ["run", "four_way", "--out", str(tmp_path / "x.mcap"), *given, *shown]
    with pytest.raises(BusError, match="enough"):
        application(["run"])(words, standalone_mode=False)
    assert speeds == [flown]


LATE = """
import os, sys, time
while "live" in sys.orig_argv and not os.path.exists(os.environ["PAGES_BEGIN"]):
    time.sleep(0.01)
"""
"""Has the processes of pages wait before anything else."""


@pytest.mark.parametrize("shown", [("--live",), ("--foxglove",)])
def test_a_run_that_is_interrupted_before_it_is_seen_says_so_alone(
    shown: tuple[str, ...], cli: Cli, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(LATE, encoding="utf-8")
    begin = tmp_path / "begin"
    here = {"XDG_RUNTIME_DIR": str(tmp_path), "PYTHONPATH": str(tmp_path)}
    words = ("run", "four_way", "--out", "x.mcap", *shown)
    fleet = cli.start(*words, **here, PAGES_BEGIN=str(begin))
    until(lambda: any(tmp_path.glob("fleet-*/*.json")))
    fleet.send_signal(signal.SIGINT)
    assert fleet.wait(60) == 130
    begin.touch()
    assert fleet.stderr is not None
    said = fleet.stderr.read().splitlines()  # to the end of the last that writes there
    assert len(said) == 2, said
    assert "changes it" in said[0]
    assert said[1].startswith("fleet: run INTERRUPTED at ")
