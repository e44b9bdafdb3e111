"""A log read from its beginning, as when it has no summary: what is good in it, and what is not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from struct import Struct
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Metadata

from fleet.log.container import MAGIC, RECORD, DamagedError, body_at, chunk_data, parse, unsealed

MARKER = "damage"
"""The name of the metadata records that a repaired log has where something is missing."""
NO_END = "the log has no end, because the run was killed or the file was cut"
"""The damage of a file without the end of its data."""

_INDEX = Struct("<HI")
"""How the body of a message index begins: channel, bytes that follow."""
_CHUNK_SIGN = b"\x04\x00\x00\x00zstd"
_CHUNK_SIGN_AT = RECORD.size + 28
"""What our chunks have this many bytes after their beginning: the name of their compression."""
_BLOCK = 1 << 20
_DATA_SECTION = frozenset(
    {
        Opcode.HEADER,
        Opcode.CHUNK,
        Opcode.MESSAGE_INDEX,
        Opcode.METADATA,
        Opcode.ATTACHMENT,
        Opcode.DATA_END,
    }
)


@dataclass(frozen=True, slots=True)
class ChunkData:
    """A chunk: what it holds, uncompressed and verified."""

    offset: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Note:
    """A metadata record, verified, without its checksum."""

    offset: int
    name: str
    values: dict[str, str]


@dataclass(frozen=True, slots=True)
class Damage:
    """Something that is wrong with a file, in words.

    `lost`: records are missing because of it; `told`: the text says already which ones.
    """

    offset: int
    text: str
    lost: bool = True
    told: bool = False


Part = ChunkData | Note | Damage


def parts_of(file: IO[bytes], size: int) -> Iterator[Part]:
    """What a file of `size` bytes holds up to its summary, in order."""
    offset = len(MAGIC)
    while offset < size:
        try:
            opcode, body = body_at(file, offset)
            if opcode == Opcode.DATA_END and len(body) == 4:
                return
            yield from _verified(offset, opcode, body)
        except DamagedError as error:
            after = _next_record(file, offset, size)
            if after == size:
                break  # nothing follows: the file was cut here
            yield Damage(offset, f"the record at byte {offset:,} is damaged ({error})")
            offset = after
        else:
            offset += RECORD.size + len(body)
    yield Damage(offset, NO_END)


def chunk_damaged(offset: int, error: DamagedError) -> str:
    """The damage of a chunk, in words."""
    return f"the chunk at byte {offset:,} is damaged ({error})"


def note_of(offset: int, body: bytes) -> Note | Damage:
    """A metadata record; raises DamagedError."""
    record = parse(Metadata, body)
    values = unsealed(record)
    if record.name == MARKER:
        return Damage(offset, values.get("what", "something is missing"), told=True)
    return Note(offset, record.name, values)


def _verified(offset: int, opcode: int, body: bytes) -> Iterator[Part]:
    """What there is to know of a record; raises DamagedError.

    Nothing may be skipped on the word of its opcode alone, for one changed byte makes it another.
    """
    if opcode == Opcode.CHUNK:
        yield ChunkData(offset, chunk_data(body))
    elif opcode == Opcode.METADATA:
        yield note_of(offset, body)
    elif opcode == Opcode.MESSAGE_INDEX:
        if len(body) < _INDEX.size or _INDEX.unpack_from(body)[1] != len(body) - _INDEX.size:
            raise DamagedError("it is no index")
    elif opcode != Opcode.HEADER or offset != len(MAGIC):
        raise DamagedError("it is of no kind that a fleet log has")


def _next_record(file: IO[bytes], offset: int, size: int) -> int:
    """Where reading can go on after a damaged record; `size` if nowhere."""
    file.seek(offset)
    head = file.read(RECORD.size)
    if len(head) == RECORD.size:
        after = offset + RECORD.size + int(RECORD.unpack(head)[1])
        file.seek(min(after, size))
        head = file.read(RECORD.size)
        if len(head) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            if opcode in _DATA_SECTION and after + RECORD.size + length <= size:
                return after
    return _next_chunk(file, offset + 1, size)


def _next_chunk(file: IO[bytes], offset: int, size: int) -> int:
    """Where the next chunk seems to begin, or `size`; whether it is one, its checksum tells."""
    at = offset + _CHUNK_SIGN_AT
    while at < size:
        file.seek(at)
        block = file.read(_BLOCK)
        found = block.find(_CHUNK_SIGN)
        if found >= 0:
            return at + found - _CHUNK_SIGN_AT
        at += max(len(block) - len(_CHUNK_SIGN) + 1, 1)
    return size
