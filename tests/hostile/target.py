"""What a fuzzer calls: a target takes any bytes, and nothing but what it allows comes out of it."""

from __future__ import annotations

import random
import signal
import traceback
import types
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import msgspec

PROJECT = ("fleet", "agents", "coordinator")


class Target(Protocol):
    """Fails, by whatever exception, exactly if an input does what no input may do.

    `accepted` counts inputs that went all the way, and were not refused; `together` is how many may
    have their effect at once.
    """

    name: str
    accepted: int
    together: int
    limit_s: float

    def seeds(self) -> list[bytes]:
        """Inputs to begin with."""
        ...

    def mutate(self, rng: random.Random, data: bytes) -> bytes:
        """Another input like one."""
        ...

    def __call__(self, data: bytes) -> None:
        """Take an input."""
        ...


class TooSlowError(BaseException):
    """An input takes more processor time than any may."""


class Finding(msgspec.Struct):
    """An exception that came out of a target, where, of which inputs; the last is the cause."""

    what: str
    where: str
    inputs: list[bytes]
    count: int = 1


class Watched:
    """A target whose failures are kept as findings, one for each place, instead of raised."""

    HISTORY = 160
    """So many inputs are kept that came before: victims remember what they have heard."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self.findings: dict[tuple[str, str], Finding] = {}
        self.inputs = 0
        self._last: list[bytes] = []

    def __call__(self, data: bytes) -> None:
        """Take an input."""
        self.inputs += 1
        self._last.append(data)
        if len(self._last) > 2 * self.HISTORY:
            del self._last[: self.HISTORY]
        try:
            with limited(self.target.limit_s):
                self.target(data)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 (whatever it is, it is a finding)
            self._keep(error)

    def _keep(self, error: BaseException) -> None:
        where = place_of(error)
        key = type(error).__name__, where
        if key in self.findings:
            self.findings[key].count += 1
            return
        told = "".join(traceback.format_exception(error)[-6:])[-3000:]
        self.findings[key] = Finding(told, where, self._last[-self.HISTORY :])


def place_of(error: BaseException) -> str:
    """Where in the project an exception came from: the innermost line of it."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if {*Path(f.filename).parts} & {*PROJECT}]
    frame = (own or frames)[-1] if frames else None
    return f"{Path(frame.filename).name}:{frame.lineno} {frame.name}" if frame else "?"


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raises TooSlowError when so much processor time has been used (0: no limit)."""
    if not seconds:
        yield
        return
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def _too_slow(_signal: int, _frame: types.FrameType | None) -> None:
    raise TooSlowError


def watch() -> None:
    """Let time limits act from now on, and numbers that overflow be failures."""
    signal.signal(signal.SIGVTALRM, _too_slow)
    warnings.simplefilter("error", RuntimeWarning)
