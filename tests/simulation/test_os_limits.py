"""Limits of the operating system that are too low are named before anything is started."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.errors import NoRoomError
from fleet.simulation.os_limits import FILES, FILES_EACH, check_room
from tests.conftest import Cli


def limited(files: int, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command with so few open files."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))

    return subprocess.run(
        [sys.executable, "-m", "fleet", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=limit,
        check=False,
    )


@pytest.mark.parametrize("files", [16, 32, 44])
def test_few_open_files_are_named_before_anything_is_started(files: int, tmp_path: Path) -> None:
    done = limited(files, tmp_path, "run", "four_way", "--duration", "1")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert f"5 processes need 45 open files, and the limit is {files}" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_as_many_as_are_said_to_be_needed_are_enough(tmp_path: Path) -> None:
    needed = FILES + FILES_EACH * 5
    done = limited(needed, tmp_path, "run", "four_way", "--duration", "1", "--json")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_run_in_one_process_needs_no_room(tmp_path: Path) -> None:
    done = limited(32, tmp_path, "run", "side", "--duration", "1", "--bus", "memory", "--json")
    assert (done.returncode, done.stderr) == (0, "")


def test_the_soft_limit_is_raised_where_the_hard_one_allows_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[tuple[int, int]] = []
    monkeypatch.setattr("resource.getrlimit", lambda _: (256, 4096))
    monkeypatch.setattr("resource.setrlimit", lambda _, limits: told.append(limits))
    check_room(70)
    assert told == []
    check_room(101)
    assert told == [(333, 4096)]
    with pytest.raises(NoRoomError, match="2001 processes need 6033 open files"):
        check_room(2001)
    monkeypatch.setattr("resource.getrlimit", lambda _: (256, resource.RLIM_INFINITY))
    check_room(2001)
    assert told[1:] == [(6033, resource.RLIM_INFINITY)]


def test_a_long_name_for_temporary_files_is_named(cli: Cli) -> None:
    for length, code in ((75, 0), (76, 1)):
        folder = cli.folder / ("x" * (length - len(str(cli.folder)) - 1))
        folder.mkdir()
        done = cli.run("run", "side", "--duration", "1", "--json", TMPDIR=str(folder))
        assert done.returncode == code, done.stderr
    assert done.stderr.count("\n") == 1
    assert "is too long for a socket in it: set TMPDIR to one of at most 75 bytes" in done.stderr
