"""Writing a damaged log anew, with all of it that is good."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.writer import CompressionType, Writer

from fleet.errors import LogError
from fleet.log.chunk import Messages
from fleet.log.container import DamagedError, open_file, sealed
from fleet.log.contents import ChunkSpan, Contents, contents_of
from fleet.log.new_files import keep, new_file
from fleet.log.recorder import CHUNK_BYTES, PROFILE
from fleet.log.scan import MARKER, Damage, Note, chunk_damaged
from fleet.protocol.codec import kind_of
from fleet.version import __version__


@dataclass
class Recovered:
    """What was kept, and in words what was lost."""

    out: Path
    messages: int = 0
    until_ns: int = 0
    lost: list[str] = field(default_factory=list)


def recover(path: Path, out: Path, *, overwrite: bool = False) -> Recovered:
    """Write what is good of a log to `out`: schemas, channels, metadata and messages, in order.

    Where something is missing, a metadata record `damage` says what, so that nobody takes the new
    log for a whole one. `out` is there when all of it has been written, or not at all.

    Raises:
        LogError: `path` is no log or `out` must not be written; LogWriteError: it cannot be.

    """
    try:
        source = open_file(path)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    with source:
        keep(path, out)
        contents = contents_of(path, source)
        with new_file(out, overwrite=overwrite) as part, part.open("wb") as target:
            return _Copy(contents, source, target, Recovered(out)).write()


class _Copy:
    """Copies what is good."""

    def __init__(
        self, contents: Contents, source: IO[bytes], target: IO[bytes], found: Recovered
    ) -> None:
        self._contents = contents
        self._source = source
        self._found = found
        self._writer = Writer(target, CHUNK_BYTES, CompressionType.ZSTD, enable_data_crcs=True)
        self._channels: dict[int, int] = {}

    def write(self) -> Recovered:
        """Everything, in the order of the file."""
        contents, writer = self._contents, self._writer
        writer.start(PROFILE, f"fleet {__version__}")
        schemas = {
            id_: writer.register_schema(s.name, s.encoding, s.data)
            for id_, s in sorted(contents.schemas.items())
        }
        for id_, c in sorted(contents.channels.items()):
            schema = schemas.get(c.schema_id, 0)
            if not schema and id_ not in contents.foreign:  # lost; its name tells that it is ours
                schema = writer.register_schema(f"{PROFILE}.{kind_of(c.topic)}", "", b"")
            self._channels[id_] = writer.register_channel(
                c.topic, c.message_encoding, schema, c.metadata
            )
        parts: list[Note | ChunkSpan | Damage] = [
            *contents.notes,
            *contents.readable,
            *contents.damage,
        ]
        for part in sorted(parts, key=lambda p: p.offset):
            if isinstance(part, ChunkSpan):
                self._copy(part)
            elif isinstance(part, Note):
                self._note(part.name, part.values)
            elif part.lost:
                self._mark(part)
        writer.finish()
        return self._found

    def _copy(self, span: ChunkSpan) -> None:
        try:
            messages = self._contents.read(self._source, span)
        except DamagedError as error:
            damage = Damage(span.offset, chunk_damaged(span.offset, error))
            self._contents.damage.append(damage)
            self._mark(damage)
        else:
            self._add(messages)

    def _add(self, messages: Messages) -> None:
        head = messages.heads.itemsize
        for (id_, seq, log_ns, sent_ns), body in zip(
            messages.heads.tolist(), messages.bodies(), strict=True
        ):
            channel = self._channels.get(id_)
            if channel is not None:
                self._writer.add_message(channel, log_ns, body[head:], sent_ns, seq)
                self._found.messages += 1
                self._found.until_ns = max(self._found.until_ns, log_ns)

    def _mark(self, damage: Damage) -> None:
        what = self._contents.describe(damage)
        self._found.lost.append(what)
        self._note(MARKER, {"what": what})

    def _note(self, name: str, values: dict[str, str]) -> None:
        self._writer.flush()  # or it would come before messages that are still to be written
        self._writer.add_metadata(name, sealed(name, values))
