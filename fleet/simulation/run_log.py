"""The log of a run that goes on where its log cannot be written."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from msgspec import Struct

from fleet.errors import LogWriteError
from fleet.log.recorder import LogRecorder


class LogEnd(Struct, frozen=True):
    """Why a log ends before its run, and in which tick; None where nothing of it is left."""

    why: str
    tick: int | None


def log_end(recorder: LogRecorder, error: LogWriteError, tick_ns: int) -> LogEnd:
    """Where a log ends that has failed."""
    return LogEnd(str(error), recorder.flushed_ns // tick_ns if recorder.is_readable else None)


class DispensableLog:
    """Records as long as that is possible, and says once when it is not."""

    def __init__(self, recorder: LogRecorder, tick_ns: int) -> None:
        self._recorder, self._tick_ns = recorder, tick_ns
        self.end: LogEnd | None = None

    def __enter__(self) -> Self:
        """The file is open already."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the file, if it has not failed."""
        self._try(self._recorder.finish)

    def write(self, topic: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Record one message, as `LogRecorder` does."""
        self._try(self._recorder.write, topic, payload, seq, sent_ns, log_ns)

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record, as `LogRecorder` does."""
        self._try(self._recorder.metadata, name, values)

    def _try(self, act: Callable[..., None], *given: Any) -> None:
        if self.end is not None:
            return
        try:
            act(*given)
        except LogWriteError as error:
            self.end = log_end(self._recorder, error, self._tick_ns)
            print(
                f"fleet: warning: {error}; the run goes on without one",
                file=sys.stderr,
                flush=True,
            )
