"""What the recorder keeps of each chunk until the log's summary is written, in little memory.

There is a chunk a second, and of each the place of every topic's messages in it: as the MCAP
library has it, that takes 5 KB a chunk with 16 UAVs, so that a simulation would grow by 17 MB an
hour. Packed it is a seventh of that.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator

from mcap.records import ChunkIndex
from mcap.writer import Writer

_NUMBERS = struct.Struct("<9Q")
_LIST = "_Writer__chunk_indices"
"""Where the library keeps them; if another version has them elsewhere, they only take more room."""


class PackedChunkIndices(list[ChunkIndex]):
    """In place of the library's list: it appends, and iterates once."""

    def __init__(self) -> None:
        super().__init__()
        self._packed: list[tuple[str, bytes]] = []

    def append(self, index: ChunkIndex) -> None:
        """Keep one."""
        self._packed.append((index.compression, packed_index(index)))

    def __iter__(self) -> Iterator[ChunkIndex]:
        return (index_of(*one) for one in self._packed)

    def __len__(self) -> int:
        return len(self._packed)


def keep_packed(writer: Writer) -> None:
    """Let a writer that has not written yet keep its chunk indices packed."""
    if hasattr(writer, _LIST):
        setattr(writer, _LIST, PackedChunkIndices())


def packed_index(index: ChunkIndex) -> bytes:
    """All numbers of a chunk index."""
    places = index.message_index_offsets
    first = min(places.values(), default=0)
    numbers = (
        index.message_start_time,
        index.message_end_time,
        index.chunk_start_offset,
        index.chunk_length,
        index.message_index_length,
        index.compressed_size,
        index.uncompressed_size,
        first,
        len(places),
    )
    beyond = array("I", (place - first for place in places.values()))
    return _NUMBERS.pack(*numbers) + array("H", places).tobytes() + beyond.tobytes()


def index_of(compression: str, data: bytes) -> ChunkIndex:
    """The chunk index of its numbers."""
    begin, end, offset, length, indices, small, large, first, count = _NUMBERS.unpack_from(data)
    channels, beyond = array("H"), array("I")
    middle = _NUMBERS.size + count * channels.itemsize
    channels.frombytes(data[_NUMBERS.size : middle])
    beyond.frombytes(data[middle:])
    return ChunkIndex(
        message_start_time=begin,
        message_end_time=end,
        chunk_start_offset=offset,
        chunk_length=length,
        message_index_length=indices,
        compressed_size=small,
        uncompressed_size=large,
        compression=compression,
        message_index_offsets={c: first + b for c, b in zip(channels, beyond, strict=True)},
    )
