"""What a log holds and where: from its summary, or from what can be read without one."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from struct import Struct
from typing import IO

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Header,
    MetadataIndex,
    Schema,
    Statistics,
)

from fleet.errors import LogError
from fleet.log.chunk import Messages, messages_in
from fleet.log.container import (
    MAGIC,
    MESSAGE,
    RECORD,
    DamagedError,
    body_at,
    chunk_data,
    parse,
    records_in,
)
from fleet.log.foreign import is_foreign
from fleet.log.recorder import PROFILE
from fleet.log.scan import NO_END, ChunkData, Damage, Note, chunk_damaged, note_of, parts_of

_FOOTER = Struct("<BQQQI")
"""Opcode, length, begin of the summary, begin of its offsets, checksum of the summary."""
_DATA_END_BYTES = RECORD.size + 4
_BLOCK = 1 << 20
_MOST_INDEX_BYTES = 1 << 28


@dataclass(frozen=True, slots=True)
class ChunkSpan:
    """Where a chunk is, and what is in it: times of recording in ns, channels.

    Behind it are `index_bytes` of message indexes, 0 if that is not known.
    """

    offset: int
    first_ns: int
    last_ns: int
    channels: frozenset[int]
    index_bytes: int = 0


@dataclass
class Contents:
    """What a log holds. `damage` is what is known to be wrong; it grows as chunks are read.

    `counts` has the messages by channel: as many as were recorded, if the log has its summary
    (`indexed`), else as many as can be read. `foreign` are the channels of other programs.
    """

    path: Path
    indexed: bool
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    spans: list[ChunkSpan] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    foreign: frozenset[int] = frozenset()

    @property
    def readable(self) -> list[ChunkSpan]:
        """The chunks that are not known to be damaged."""
        lost = {damage.offset for damage in self.damage}
        return [span for span in self.spans if span.offset not in lost]

    def read(self, file: IO[bytes], span: ChunkSpan) -> Messages:
        """The messages of a chunk, verified; raises DamagedError."""
        opcode, body = body_at(file, span.offset)
        if opcode != Opcode.CHUNK:
            raise DamagedError("it is not there")
        return messages_in(chunk_data(body), file.read(min(span.index_bytes, _MOST_INDEX_BYTES)))

    def describe(self, damage: Damage) -> str:
        """One line: what is wrong, and what is missing because of it."""
        if not damage.lost or damage.told:
            return damage.text
        for span in self.spans:
            if span.offset == damage.offset:
                return f"{damage.text}: {_recorded(span.first_ns, span.last_ns)} is missing"
        before = [s.last_ns for s in self.readable if s.offset < damage.offset]
        after = [s.first_ns for s in self.readable if s.offset > damage.offset]
        if damage.text == NO_END:
            until = f"up to {max(before, default=0) / 1e9:g} s"
            return f"{damage.text}: read {until}, {self.counts.total():,} messages"
        lost = _recorded(max(before, default=None), min(after, default=None))
        return f"{damage.text}: {lost} may be missing"


def _recorded(since_ns: int | None, until_ns: int | None) -> str:
    since = "the beginning" if since_ns is None else f"{since_ns / 1e9:g} s"
    until = "the end" if until_ns is None else f"{until_ns / 1e9:g} s"
    return f"what was recorded from {since} to {until}"


def contents_of(path: Path, file: IO[bytes]) -> Contents:
    """What a log holds; raises LogError if it is no MCAP file, or has others' data as ours."""
    if file.read(len(MAGIC)) != MAGIC:
        raise LogError(f"{path} is not an MCAP file")
    size = file.seek(0, 2)
    contents = _from_summary(path, file, size) or _from_scan(path, file, size)
    if contents.counts and contents.indexed and not contents.spans:
        raise LogError(f"{path} cannot be read: its messages are not in chunks")
    channels, schemas = contents.channels.values(), contents.schemas
    contents.foreign = frozenset(c.id for c in channels if is_foreign(path, c, schemas))
    if not contents.schemas and not contents.notes and not contents.channels:
        _explain_nothing(path, file)
    return contents


def has_summary(file: IO[bytes], size: int) -> bool:
    """Whether the end of a file is as it should be."""
    return _summary(file, size) is not None


def unread_is_whole(file: IO[bytes], size: int) -> bool:
    """Whether also that is unchanged which is never read here, as the indexes for other tools."""
    file.seek(size - _FOOTER.size - len(MAGIC))
    end = int(_FOOTER.unpack(file.read(_FOOTER.size))[2]) - _DATA_END_BYTES
    try:
        opcode, body = body_at(file, end)
        told = parse(DataEnd, body).data_section_crc
    except DamagedError:
        return False
    crc = at = 0
    file.seek(0)
    while told and at < end:
        block = file.read(min(_BLOCK, end - at))
        crc, at = zlib.crc32(block, crc), at + len(block)
    return opcode == Opcode.DATA_END and crc == told


def _explain_nothing(path: Path, file: IO[bytes]) -> None:
    try:
        profile = parse(Header, body_at(file, len(MAGIC))[1]).profile
    except DamagedError:
        profile = PROFILE
    if profile == PROFILE:
        raise LogError(f"{path} holds no fleet run: nothing in it can be read")
    raise LogError(
        f"{path} is not a fleet log and holds no fleet run "
        f"(an MCAP file written by '{PROFILE}' is expected)"
    )


def _summary(file: IO[bytes], size: int) -> bytes | None:
    """The summary, verified by its checksum; None if there is none."""
    end = size - _FOOTER.size - len(MAGIC)
    if end < len(MAGIC):
        return None
    file.seek(end)
    footer = file.read(_FOOTER.size)
    opcode, _, begin, _, crc = _FOOTER.unpack(footer)
    if opcode != Opcode.FOOTER or file.read() != MAGIC or not 0 < begin <= end:
        return None
    file.seek(begin)
    summary = file.read(end - begin)
    return summary if zlib.crc32(summary + footer[:-4]) == crc else None


def _from_summary(path: Path, file: IO[bytes], size: int) -> Contents | None:
    """The contents as the summary tells them; None without a good summary."""
    summary = _summary(file, size)
    if summary is None:
        return None
    contents, told = Contents(path, indexed=True), None
    try:
        for opcode, number, begin, end in records_in(summary):
            body = summary[begin:end]
            if opcode == Opcode.SCHEMA:
                contents.schemas[number] = parse(Schema, body)
            elif opcode == Opcode.CHANNEL:
                contents.channels[number] = parse(Channel, body)
            elif opcode == Opcode.STATISTICS:
                told = parse(Statistics, body)
            elif opcode == Opcode.CHUNK_INDEX:
                contents.spans.append(_span(parse(ChunkIndex, body)))
            elif opcode == Opcode.METADATA_INDEX:
                _add_note(contents, file, parse(MetadataIndex, body))
    except DamagedError:
        return None
    if told is None or told.chunk_count != len(contents.spans):
        return None  # a writer that leaves out what is needed here: read it without
    contents.counts.update(told.channel_message_counts)
    return contents


def _span(index: ChunkIndex) -> ChunkSpan:
    return ChunkSpan(
        index.chunk_start_offset,
        index.message_start_time,
        index.message_end_time,
        frozenset(index.message_index_offsets),
        index.message_index_length,
    )


def _add_note(contents: Contents, file: IO[bytes], index: MetadataIndex) -> None:
    try:
        opcode, body = body_at(file, index.offset)
        if opcode != Opcode.METADATA:
            raise DamagedError("it is not there")
        _add(contents, note_of(index.offset, body))
    except DamagedError as error:
        text = f"the metadata '{index.name}' are damaged ({error}) and left out"
        contents.damage.append(Damage(index.offset, text, told=True))


def _add(contents: Contents, part: Note | Damage) -> None:
    if isinstance(part, Note):
        contents.notes.append(part)
    else:
        contents.damage.append(part)


def _from_scan(path: Path, file: IO[bytes], size: int) -> Contents:
    """The contents as far as they can be read."""
    contents = Contents(path, indexed=False)
    nameless, first = 0, size
    for part in parts_of(file, size):
        if not isinstance(part, ChunkData):
            _add(contents, part)
            continue
        try:
            found = _add_chunk(contents, part)
            nameless, first = nameless + found, min(first, part.offset if found else size)
        except DamagedError as error:
            contents.damage.append(Damage(part.offset, chunk_damaged(part.offset, error)))
    if nameless:
        text = f"{nameless:,} messages are of topics whose names are lost, and left out"
        contents.damage.append(Damage(first - 1, text, told=True))
    if all(damage.text != NO_END for damage in contents.damage):
        text = "its summary is missing or damaged; read without it"
        contents.damage.append(Damage(size, text, lost=False))
    return contents


def _add_chunk(contents: Contents, part: ChunkData) -> int:
    """Note what is in a chunk; returns the number of messages whose channels are not known."""
    data, nameless = part.data, 0
    counts: Counter[int] = Counter()
    times: list[int] = []
    for opcode, number, begin, end in records_in(data):
        if opcode == Opcode.SCHEMA:
            contents.schemas[number] = parse(Schema, data[begin:end])
        elif opcode == Opcode.CHANNEL:
            contents.channels[number] = parse(Channel, data[begin:end])
        elif opcode == Opcode.MESSAGE:
            times.append(MESSAGE.unpack_from(data, begin)[2])
            if number in contents.channels:
                counts[number] += 1
            else:
                nameless += 1
    if times:
        span = ChunkSpan(part.offset, min(times), max(times), frozenset(counts))
        contents.spans.append(span)
        contents.counts += counts
    return nameless
