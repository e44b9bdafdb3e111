"""The recorder: one MCAP file a run, readable up to its last flush if the run is killed."""

from __future__ import annotations

import os
import stat
import time
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.writer import CompressionType, Writer

from fleet.errors import LogError, LogWriteError
from fleet.log.chunk_indices import keep_packed
from fleet.log.container import sealed
from fleet.log.new_files import open_new_log
from fleet.log.schema import schemas
from fleet.model.units import to_s
from fleet.protocol.codec import kind_of
from fleet.version import __version__

CHUNK_BYTES = 1 << 20
FLUSH_S = 1.0
PROFILE = "fleet"
ENCODING = "msgpack"


class LogRecorder:
    """Writes messages as they come; flushes about once a second of wall time."""

    def __init__(
        self,
        path: Path,
        *,
        overwrite: bool,
        uninterrupted: AbstractContextManager[object] | None = None,
    ) -> None:
        """`whole` is entered for every record: what must not break off in the middle."""
        self.path = path
        self._uninterrupted = uninterrupted or nullcontext()
        try:
            if path.is_dir():
                raise LogError(f"{path} is a directory; name a file in it with --out")
            if path.exists() and not overwrite:
                raise LogError(
                    f"{path} exists already, not overwriting; use --force or another --out"
                )
            self._where = path.absolute()
            self._file = open_new_log(path)
        except OSError as error:
            raise LogError(f"cannot write {path}: {error.strerror}") from error
        self._writer = Writer(
            self._file, CHUNK_BYTES, CompressionType.ZSTD, enable_crcs=True, enable_data_crcs=True
        )
        keep_packed(self._writer)
        self._writer.start(PROFILE, f"fleet {__version__}")
        encoded = schemas()
        self._schemas = {
            kind: self._writer.register_schema(f"fleet.{kind}", "jsonschema", schema)
            for kind, schema in encoded.items()
        }
        self._channels: dict[str, int] = {}
        self._open = True
        self.flushed_ns = self._written_ns = 0
        """Up to this time of the run what was written can be read, whatever comes."""
        self._flushed_s, self._flushed_bytes, self._gone = time.monotonic(), 0, False

    def __enter__(self) -> Self:
        """The file is open already."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the file, unless it has failed already."""
        self.finish()

    def write(self, topic: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Record one message: `sent_ns` is its publish time, `log_ns` when the simulation had it.

        Raises:
            LogWriteError: the file cannot be written (disk full), or has gone.

        """
        with self._uninterrupted:
            channel = self._channels.get(topic)
            if channel is None:
                schema = self._schemas[kind_of(topic)]
                channel = self._writer.register_channel(topic, ENCODING, schema)
                self._channels[topic] = channel
            try:
                self._writer.add_message(channel, log_ns, payload, sent_ns, seq & 0xFFFFFFFF)
                self._written_ns = max(self._written_ns, log_ns)
                if time.monotonic() - self._flushed_s > FLUSH_S:
                    self._flush()
                    self._check_there()
            except OSError as error:
                raise self._failed(error) from error

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record, with a checksum; raises LogWriteError as `write` does."""
        with self._uninterrupted:
            try:
                self._flush()  # or it would come before messages written earlier
                self._writer.add_metadata(name, sealed(name, values))
                self._flush()
            except OSError as error:
                raise self._failed(error) from error

    def finish(self) -> None:
        """Write the summary and close; raises LogWriteError as `write` does."""
        if not self._open:
            return
        with self._uninterrupted:
            try:
                self._writer.finish()
                self._file.flush()
                self._check_there()
                self._open = False
                self._file.close()
            except OSError as error:
                raise self._failed(error) from error

    @property
    def is_readable(self) -> bool:
        """Whether something of the run is on record."""
        return self._flushed_bytes > 0 and not self._gone

    def _flush(self) -> None:
        """Have the file take all that was written."""
        self._flushed_s = time.monotonic()
        self._writer.flush()
        self.flushed_ns, self._flushed_bytes = self._written_ns, self._file.tell()

    def _check_there(self) -> None:
        """Raises LogWriteError if the file is no longer where it was opened."""
        if not self._is_there():
            self._gone = True
            self._give_up()
            raise LogWriteError(
                f"{self.path} has been removed or replaced while the run was on: there is no log "
                "of it"
            )

    def _is_there(self) -> bool:
        """Whether the file is still where it was opened; what is no file, as a pipe, always is."""
        own = os.fstat(self._file.fileno())
        if not stat.S_ISREG(own.st_mode):
            return True
        try:
            return os.path.samestat(own, self._where.stat())
        except (FileNotFoundError, NotADirectoryError):
            return False

    def _failed(self, error: OSError) -> LogWriteError:
        self._give_up()
        return LogWriteError(
            f"cannot write {self.path}: {error.strerror}; the log ends at its last flush, at "
            f"{to_s(self.flushed_ns):g} s"
        )

    def _give_up(self) -> None:
        """Close the file at the end of its last flush: what came after is in part."""
        self._open = False
        left = os.dup(self._file.fileno())
        with suppress(OSError):  # what it still holds cannot be written: that is known by now
            self._file.close()
        with suppress(OSError):  # of what is no file
            os.ftruncate(left, self._flushed_bytes)
        os.close(left)
