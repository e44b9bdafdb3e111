"""New files: whole or not at all, and over nothing that is there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from fleet.errors import LogError, LogWriteError
from fleet.log.new_files import new_file, new_folder


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
