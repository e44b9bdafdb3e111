"""A log that cannot be written any more: the run stops, or goes on without one, as was asked."""

from __future__ import annotations

import json
import resource
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from fleet.config.loading import load_scenario
from fleet.log.reader import read
from fleet.log.recovery import recover
from fleet.model.words import OnLogError
from fleet.simulation.result import result_json
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.conftest import Cli, fly
from tests.support.replay_tools import until

FULL = Path("/dev/full")
TICKS = 101


@contextmanager
def room_for(size_bytes: int) -> Iterator[None]:
    """No file may be larger meanwhile: as where a disk is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("choice", OnLogError)
def test_a_disk_that_fills_up_leaves_a_log_that_ends_where_the_result_says(
    tmp_path: Path, choice: OnLogError, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    monkeypatch.setattr("fleet.log.recorder.FLUSH_S", 0.0)
    scenario, log = load_scenario("head_on", {"duration_s": 10.0}), tmp_path / "x.mcap"
    options = RunOptions(scenario, bus="memory", out=log, on_log_error=choice)
    with room_for(250_000):
        outcome = run_fleet(options, lambda _: None)
    result = result_json(outcome)
    end = result["log_end"]
    assert end["why"].startswith(f"cannot write {log}: File too large; the log ends at")
    assert result["log"] == str(log)
    if choice is OnLogError.STOP:
        assert (result["status"], result["why"]) == ("invalid", end["why"])
        # it is over with the tick in which the log failed
        assert outcome.ticks in (end["tick"], end["tick"] + 1)
    else:
        assert (result["status"], outcome.ticks) == ("complete", TICKS)
        assert result["digest"] == fly("head_on", "duration_s=10").digest
        warning = f"fleet: warning: {end['why']}; the run goes on without one\n"
        assert capfd.readouterr().err == warning
    _check_readable(log, end["tick"])


def _check_readable(log: Path, tick: int) -> None:
    """It holds what was flown up to a tick, and all of that can be recovered."""
    assert 0 < tick < TICKS - 1
    held = list(read(log))
    assert max(record.log_ns for record in held) // 10**8 == tick
    whole = log.with_name("whole.mcap")
    recover(log, whole)
    assert list(read(whole)) == held


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux only")
@pytest.mark.parametrize(("choice", "code"), [("stop", 1), ("continue", 0)])
def test_processes_are_released_where_nothing_can_be_logged(
    cli: Cli, choice: str, code: int
) -> None:
    flags = ("--duration", "5", "--out", "/dev/full", "--force", "--on-log-error", choice)
    fleet = cli.start("run", "head_on", *flags, "--json")
    out, err = fleet.communicate(timeout=60)
    assert fleet.returncode == code, err
    assert err.count("\n") == 1
    assert "cannot write /dev/full: No space left on device" in err
    found = json.loads(out)
    assert found["log_end"]["tick"] is None
    assert found["log"] == ""
    assert found["status"] == ("invalid" if code else "complete")
    until(lambda: not cli.members(fleet))  # what forked them ends a moment later


@pytest.mark.parametrize(("choice", "code"), [("stop", 1), ("continue", 0)])
def test_a_log_whose_folder_is_removed_is_told_of_while_the_run_is_on(
    cli: Cli, choice: str, code: int
) -> None:
    folder = cli.folder / "logs"
    folder.mkdir()
    duration_s = 600 if code else 8
    flags = ("--duration", str(duration_s), "--speed", "2", "--on-log-error", choice, "--json")
    fleet = cli.start("run", "head_on", *flags, "--out", "logs/x.mcap")
    while not (folder / "x.mcap").exists():
        assert fleet.poll() is None
    shutil.rmtree(folder)
    out, err = fleet.communicate(timeout=60)  # not the 300 s of the whole run
    assert fleet.returncode == code, err
    told = [line for line in err.splitlines() if "has been removed or replaced" in line]
    assert len(told) == 1
    found = json.loads(out)
    assert (found["log"], found["log_end"]["tick"]) == ("", None)
    assert (found["sim_s"] == duration_s) is (code == 0)
    assert not folder.exists()
