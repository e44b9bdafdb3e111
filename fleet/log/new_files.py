"""Where new files go: never over something that is there, unless told to, and never half.

Never over a log that a run is still writing either. Who writes one holds an advisory lock on the
file, which is gone with its process, however that ends.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from fleet.errors import LogError, LogWriteError


def keep(source: Path, *outs: Path | None) -> None:
    """Raises LogError if one of the paths to be written is the file that is read."""
    for out in outs:
        try:
            same = out is not None and out.samefile(source)
        except OSError:  # one of them is not there
            continue
        if same:
            raise LogError(f"{out} is what is read; name another with --out")


def open_new_log(path: Path) -> IO[bytes]:
    """A log to be written from its start, locked while it is open; raises LogError, OSError.

    What is in it is gone only once the lock is there.
    """
    file = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT, 0o666), "wb")
    try:
        _lock(file, fcntl.LOCK_EX, path)
        if _is_regular(file):
            file.truncate()
    except BaseException:
        file.close()
        raise
    return file


def _check_unwritten(path: Path) -> None:
    """Raises LogError if a run is writing this file."""
    with suppress(OSError), path.open("rb") as file:
        _lock(file, fcntl.LOCK_SH, path)


def _lock(file: IO[bytes], how: int, path: Path) -> None:
    """Lock a file at once; devices are for everybody, and some file systems have no locks."""
    if not _is_regular(file):
        return
    try:
        fcntl.flock(file, how | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as error:
        raise LogError(
            f"{path} is being written by another run; name another with --out"
        ) from error
    except OSError:
        pass


def _is_regular(file: IO[bytes]) -> bool:
    return stat.S_ISREG(os.fstat(file.fileno()).st_mode)


@contextmanager
def new_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A path to write to, which becomes `path` when all went well.

    Raises:
        LogError: it must not be written there; LogWriteError: it cannot be.

    """
    if path.is_dir():
        raise LogError(f"{path} is a directory; name a file in it with --out")
    if path.exists() and not path.is_file():
        raise LogError(f"{path} is a device or a pipe, which would be replaced; name a file")
    if path.exists() and not overwrite:
        raise LogError(f"{path} exists already, not overwriting; use --force or another --out")
    _check_unwritten(path)
    with _workshop(path) as folder:
        part = folder / path.name
        yield part
        part.replace(path)


@contextmanager
def new_folder(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A folder to write to, whose files are in `path` when all went well.

    Files of other names that are in `path` already stay there.

    Raises:
        LogError: it must not be written there; LogWriteError: it cannot be.

    """
    if path.exists() and not path.is_dir():
        raise LogError(f"{path} is a file; name a directory with --out")
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise LogError(f"{path} is not empty, not overwriting; use --force or another --out")
    with _workshop(path) as folder:
        yield folder
        path.mkdir(exist_ok=True)
        for file in sorted(folder.iterdir()):
            file.replace(path / file.name)


@contextmanager
def _workshop(path: Path) -> Iterator[Path]:
    """A hidden folder beside a path that is nobody else's, and is gone afterwards."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror or error}") from error
    try:
        yield folder
    except OSError as error:
        raise LogWriteError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
