"""MCAP files for other people's viewers: JSON messages, each with the schema of its class."""

from __future__ import annotations

import json
from typing import IO, Self

import msgspec
from mcap.writer import CompressionType, Writer

from fleet.log.recorder import CHUNK_BYTES
from fleet.log.schema import self_contained
from fleet.version import __version__

_encoder = msgspec.json.Encoder()


class ForeignWriter:
    """Writes structs as JSON. To `fleet info`, all topics of the file are foreign."""

    def __init__(self, file: IO[bytes]) -> None:
        """`file` is open for writing; all methods raise OSError if it cannot be written."""
        self._writer = Writer(file, CHUNK_BYTES, CompressionType.ZSTD)
        self._writer.start("", f"fleet {__version__}")  # no profile: each channel says what it has
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def __enter__(self) -> Self:
        """Ready to write."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the index, unless something went wrong before."""
        if kind is None:
            self._writer.finish()

    def write(self, topic: str, schema: str, t_ns: int, message: msgspec.Struct) -> None:
        """Add a message of a class that viewers know as `schema`."""
        channel = self._channels.get(topic)
        if channel is None:
            number = self._schema(schema, type(message))
            channel = self._writer.register_channel(topic, "json", number)
            self._channels[topic] = channel
        self._writer.add_message(channel, t_ns, _encoder.encode(message), t_ns)

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, values)

    def _schema(self, name: str, cls: type[msgspec.Struct]) -> int:
        if name not in self._schemas:
            encoded = json.dumps(self_contained(cls, name)).encode()
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", encoded)
        return self._schemas[name]
