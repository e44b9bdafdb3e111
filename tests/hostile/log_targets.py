"""Logs as targets: each is read by a command of `fleet`, or loaded to be replayed."""

from __future__ import annotations

import contextlib
import io
import random
import shutil
import tempfile
import weakref
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import typer

from fleet.cli import application
from fleet.errors import FleetError
from fleet.log.reader import DAMAGE, read
from fleet.playback.schedule import Window, replay_messages
from fleet.playback.topics import Selection
from tests.hostile import corpus
from tests.hostile.log_input import log_bytes, mutated_file, mutated_log

COMMANDS: tuple[tuple[str, ...], ...] = (
    ("info", "LOG"),
    ("cat", "LOG", "--format", "csv"),
    ("cat", "LOG"),
    ("check", "LOG"),
    ("check", "LOG", "--json"),
    ("metrics", "LOG"),
    ("metrics", "LOG", "--json"),
    ("recover", "LOG", "--out", "OUT.mcap", "--force"),
    ("export", "LOG", "--csv", "--out", "OUT", "--force"),
    ("export", "LOG", "--foxglove", "--out", "OUT.fox.mcap", "--force"),
    ("report", "LOG", "--out", "OUT.html", "--force"),
    ("replay",),
)
EXIT_CODES = (0, 1, 2, 3, None)


class ExitError(Exception):
    """A command ended with a code that it does not have."""


class LogTarget:
    """Inputs of one form, made files and read."""

    limit_s = 60.0

    def __init__(
        self,
        name: str,
        made: Callable[[bytes], bytes],
        mutate: Callable[[random.Random, bytes], bytes],
    ) -> None:
        self.name, self._made, self._mutate = name, made, mutate
        self.accepted, self.together = 0, 1
        folder = tempfile.mkdtemp(prefix="hostile-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self._folder = Path(folder)

    def seeds(self) -> list[bytes]:
        """Small logs of runs."""
        return corpus.stored(self.name)

    def mutate(self, rng: random.Random, data: bytes) -> bytes:
        """Another log."""
        return self._mutate(rng, data)

    def __call__(self, data: bytes) -> None:
        """Read it with one of the commands, by a hash of it."""
        try:
            file = self._made(data)
        except (ValueError, OverflowError, *DAMAGE):
            return  # no file can be made of it
        log = self._folder / "given.mcap"
        log.write_bytes(file)
        words = COMMANDS[zlib.crc32(data) % len(COMMANDS)]
        with contextlib.suppress(FleetError, typer.TyperException):
            self.accepted += self._read(words, log)

    def _read(self, words: tuple[str, ...], log: Path) -> bool:
        if words == ("replay",):
            return _loaded(log)
        out = str(self._folder / "out")
        arguments = [w.replace("LOG", str(log)).replace("OUT", out) for w in words]
        with _quiet():
            code: Any = _command(words[0]).main(arguments[1:], standalone_mode=False)
        if code not in EXIT_CODES:
            raise ExitError(code)
        return bool(code == 0)


def _loaded(log: Path) -> bool:
    """Load all of a log to be replayed; nothing is sent."""
    messages = replay_messages(lambda: read(log), Window(), Selection(), loop=False)
    return sum(1 for _ in messages) > 0


@cache
def _command(name: str) -> Any:
    """A command of `fleet`."""
    return typer.main.get_command(application([name])).commands[name]  # type: ignore[attr-defined]


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """What is printed goes nowhere."""
    text = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        yield


def _as_it_is(data: bytes) -> bytes:
    return data


LOGS: dict[str, Callable[[], LogTarget]] = {
    "log": lambda: LogTarget("log", log_bytes, mutated_log),
    "file": lambda: LogTarget("file", _as_it_is, mutated_file),
}
