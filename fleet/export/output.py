"""Where exports go: never over something that is there, unless told to, and never half."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fleet.log.recorder import LogError


@contextmanager
def fresh_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A path to write to, which becomes `path` when all went well; raises LogError."""
    if path.is_dir():
        raise LogError(f"{path} is a directory; name a file in it with --out")
    if path.exists() and not overwrite:
        raise LogError(f"{path} exists already, not overwriting; use --force or another --out")
    part = _part(path)
    with _told(path):
        try:
            part.touch()
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def fresh_folder(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A folder to write to, whose files are in `path` when all went well; raises LogError.

    Files of other names that are in `path` already stay there.
    """
    if path.exists() and not path.is_dir():
        raise LogError(f"{path} is a file; name a directory with --out")
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise LogError(f"{path} is not empty, not overwriting; use --force or another --out")
    part = _part(path)
    with _told(path):
        try:
            part.mkdir()
            yield part
            path.mkdir(exist_ok=True)
            for file in sorted(part.iterdir()):
                file.replace(path / file.name)
        finally:
            shutil.rmtree(part, ignore_errors=True)


def _part(path: Path) -> Path:
    return path.with_name(f".{path.name}.part")


@contextmanager
def _told(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror or error}") from error
