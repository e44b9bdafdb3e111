"""New files: whole or not at all, and over nothing that is there."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from fleet.errors import LogError, LogWriteError
from fleet.log.new_files import new_file, new_folder
from fleet.log.reader import summarise
from fleet.log.recorder import LogRecorder
from tests.conftest import Cli


def test_a_file_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    def fail() -> None:
        with new_file(tmp_path / "a", overwrite=False) as part:
            part.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(LogWriteError, match=r"cannot write .*a: No space left"):
        fail()
    assert not list(tmp_path.iterdir())
    with (
        pytest.raises(LogError, match="is a directory"),
        new_file(tmp_path, overwrite=True),
    ):
        pass


def test_a_folder_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    def write(*, fail: bool, overwrite: bool = False) -> None:
        with new_folder(tmp_path / "d", overwrite=overwrite) as part:
            (part / "x").write_text("new")
            if fail:
                raise ValueError

    with pytest.raises(ValueError, match=r"^$"):
        write(fail=True)
    assert not list(tmp_path.iterdir())
    write(fail=False)
    (tmp_path / "d" / "y").write_text("mine")
    with pytest.raises(LogError, match="is not empty"):
        write(fail=False)
    write(fail=False, overwrite=True)
    assert {path.name for path in (tmp_path / "d").iterdir()} == {"x", "y"}
    (tmp_path / "f").write_text("")
    refused = pytest.raises(LogError, match="is a file")
    with refused, new_folder(tmp_path / "f", overwrite=True):
        pass


def test_what_others_left_half_written_is_neither_in_the_way_nor_touched(tmp_path: Path) -> None:
    (tmp_path / ".d.part").mkdir()
    (tmp_path / "a.part").write_text("mine")
    with new_folder(tmp_path / "d", overwrite=False) as part:
        (part / "x").write_text("new")
    with new_file(tmp_path / "a", overwrite=False) as part:
        part.write_text("new")
    assert {p.name for p in tmp_path.iterdir()} == {".d.part", "a.part", "a", "d"}
    assert (tmp_path / "a.part").read_text() == "mine"


def test_where_nothing_can_be_written_is_said_at_once(tmp_path: Path) -> None:
    with (
        pytest.raises(LogError, match=r"cannot write .*: No such file"),
        new_file(tmp_path / "none" / "a", overwrite=False),
    ):
        pass


def test_a_device_is_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(LogError, match="is a device or a pipe"), new_file(pipe, overwrite=True):
        pass
    assert pipe.is_fifo()


def overwrite(path: Path) -> None:
    with LogRecorder(path, overwrite=True) as recorder:
        recorder.metadata("run", {"seed": "2"})


def replace(path: Path) -> None:
    with new_file(path, overwrite=True) as part:
        part.write_text("new")


@pytest.mark.parametrize("write", [overwrite, replace])
def test_a_log_that_is_being_written_is_not_overwritten(write: Any, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.metadata("run", {"seed": "1"})
        with pytest.raises(
            LogError, match=r"x\.mcap is being written by another run; name another"
        ):
            write(path)
    assert summarise(path).metadata["run"] == {"seed": "1"}
    write(path)


@pytest.mark.parametrize("write", [overwrite, replace])
def test_where_the_file_system_has_no_locks_it_goes_without(
    write: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    path, other = tmp_path / "x.mcap", tmp_path / "y.mcap"
    path.write_text("older and longer" * 10_000)
    write(path)
    write(other)
    assert path.read_bytes() == other.read_bytes()


def test_two_runs_do_not_write_one_log_until_the_first_has_gone(cli: Cli) -> None:
    here = {"XDG_RUNTIME_DIR": str(cli.folder)}
    words = ("run", "head_on", "--out", "x.mcap", "--force")
    first = cli.start(*words, "--speed", "1", **here)
    assert first.stderr is not None
    assert "changes it" in first.stderr.readline()
    while not (cli.folder / "x.mcap").exists():
        assert first.poll() is None
    second = cli.run(*words, "--bus", "memory", "--duration", "1", **here)
    assert second.returncode == 2
    assert second.stderr == (
        "fleet: x.mcap is being written by another run; name another with --out\n"
    )
    first.send_signal(signal.SIGKILL)
    first.wait()
    third = cli.run(*words, "--bus", "memory", "--duration", "1", **here)
    assert third.returncode == 0, third.stderr
