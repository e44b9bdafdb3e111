"""The MCAP container: single records, each verified before it is believed.

A log protects its parts one by one: chunks by their checksum, the summary by its own, metadata by
one that the recorder puts into it. So whatever is used is verified, without reading the whole file.
"""

from __future__ import annotations

import errno
import os
import stat
import struct
import zlib
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import IO, Protocol, TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, Metadata

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
"""How each record begins: opcode, length of its body."""
MESSAGE = struct.Struct("<HIQQ")
"""How the body of a message begins: channel, sequence number, log time, publish time in ns."""
CHECKSUM = "checksum"
"""The first key of our metadata records: CRC-32 of their name and all else in them."""

DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    EOFError,
    KeyError,
    ValueError,
    MemoryError,
    OverflowError,
)
"""What the MCAP library raises where a file is cut or its bytes are changed."""
MAX_CHUNK_BYTES = 16 << 20
"""No chunk is larger than this, uncompressed: those of our recorder are of 1 MiB and a message."""
_MAX_RECORD_BYTES = 4 * MAX_CHUNK_BYTES
_IN_CHUNK = struct.Struct("<BQH")
_CRC = "crc32:"
_MESSAGE = int(Opcode.MESSAGE)

T_co = TypeVar("T_co", covariant=True)


class DamagedError(Exception):
    """A part of the file is not what was written; the message says how that is known."""


class Readable(Protocol[T_co]):
    """A record class of the MCAP library."""

    @staticmethod
    def read(stream: ReadDataStream) -> T_co:
        """The record whose body the stream holds."""
        ...


def parse(record: Readable[T_co], body: bytes) -> T_co:
    """The record of a body; raises DamagedError."""
    try:
        return record.read(ReadDataStream(BytesIO(body)))
    except DAMAGE as error:
        raise DamagedError("it is not as it should be") from error


def open_file(path: Path) -> IO[bytes]:
    """A file to be read as a log; raises OSError, also for what is no file, as a pipe."""
    file = open(path, "rb", opener=_at_once)  # noqa: SIM115 (Path.open has no opener)
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is a device or a pipe, no file")
    return file


def _at_once(path: str, flags: int) -> int:
    """Open without waiting for the other end of a pipe."""
    return os.open(path, flags | os.O_NONBLOCK)


def body_at(file: IO[bytes], offset: int) -> tuple[int, bytes]:
    """Opcode and body of the record at an offset, whole; raises DamagedError."""
    try:
        file.seek(offset)
        head = file.read(RECORD.size)
        opcode, length = RECORD.unpack(head)
        body = file.read(min(length, _MAX_RECORD_BYTES))
    except struct.error as error:
        raise DamagedError("it is cut") from error
    except (OSError, OverflowError) as error:
        raise DamagedError(f"it cannot be read: {error}") from error
    if len(body) != length:
        raise DamagedError("it is cut")
    return opcode, body


def chunk_data(body: bytes) -> bytes:
    """What a chunk holds, uncompressed and verified by its checksum; raises DamagedError."""
    chunk = parse(Chunk, body)
    if chunk.uncompressed_crc == 0:
        raise DamagedError("it has no checksum")
    data = _uncompressed(chunk)
    if zlib.crc32(data) != chunk.uncompressed_crc:
        raise DamagedError("its checksum is wrong")
    return data


def _uncompressed(chunk: Chunk) -> bytes:
    if chunk.compression == "":
        return chunk.data
    if chunk.compression != "zstd":
        raise DamagedError(f"it is compressed by '{chunk.compression}'")
    try:
        size = zstandard.frame_content_size(chunk.data)
        if size not in (-1, chunk.uncompressed_size):
            raise DamagedError("its size is wrong")
        if chunk.uncompressed_size > MAX_CHUNK_BYTES:
            raise DamagedError(
                f"it would have {chunk.uncompressed_size:,} bytes, and none has more than "
                f"{MAX_CHUNK_BYTES:,}"
            )
        return zstandard.decompress(chunk.data, chunk.uncompressed_size)
    except DAMAGE as error:
        raise DamagedError("it cannot be decompressed") from error


def records_in(data: bytes) -> Iterator[tuple[int, int, int, int]]:
    """The records of a chunk or a summary: opcode, ID, and where the body begins and ends.

    The ID is that of the schema or channel, or of the channel of a message; elsewhere it says
    nothing.

    Raises:
        DamagedError: the data do not consist of records.

    """
    at, size, head, skip = 0, len(data), _IN_CHUNK.unpack_from, RECORD.size
    try:
        while at < size:
            opcode, length, number = head(data, at)
            begin = at + skip
            at = begin + length
            if at > size or (opcode == _MESSAGE and length < MESSAGE.size):
                raise DamagedError("it breaks off")
            yield opcode, number, begin, at
    except struct.error as error:
        raise DamagedError("it breaks off") from error


def sealed(name: str, values: Mapping[str, str]) -> dict[str, str]:
    """The values of a metadata record with their checksum, which comes first."""
    return {CHECKSUM: _checksum(name, values), **values}


def unsealed(record: Metadata) -> dict[str, str]:
    """The values of a metadata record without their checksum; raises DamagedError if it is wrong.

    Records without one are taken as they are: the first recorders wrote none.
    """
    values = dict(record.metadata)
    key, told = next(iter(values.items()), ("", ""))
    if key != CHECKSUM and not told.startswith(_CRC):
        return values
    values.pop(key)
    if key != CHECKSUM or told != _checksum(record.name, values):
        raise DamagedError("its checksum is wrong")
    return values


def _checksum(name: str, values: Mapping[str, str]) -> str:
    crc = 0
    for text in (name, *(part for item in values.items() for part in item)):
        raw = text.encode()
        crc = zlib.crc32(raw, zlib.crc32(len(raw).to_bytes(8, "little"), crc))
    return f"{_CRC}{crc:08x}"
