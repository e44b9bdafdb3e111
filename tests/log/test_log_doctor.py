"""Every part of the files that we write is as the MCAP specification has it, by its own library."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from mcap.data_stream import ReadDataStream
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream

from fleet.cli.export import export
from fleet.config.loading import read_scenario
from fleet.log.recorder import LogRecorder
from fleet.log.recovery import recover
from fleet.simulation.simulation import RunOptions, run_fleet

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")


@dataclass
class Doctor:
    """Goes through a file record by record; what is not as it should be is an assertion."""

    content: bytes
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: dict[int, Chunk] = field(default_factory=dict)
    notes: dict[int, Metadata] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    times: list[int] = field(default_factory=list)

    def examine(self) -> None:
        """All of it."""
        assert self.content[:8] == self.content[-8:] == MAGIC
        placed = self._placed()
        ends = next(n for n, (_, r) in enumerate(placed) if isinstance(r, DataEnd))
        assert isinstance(placed[0][1], Header)
        assert isinstance(placed[-1][1], Footer)
        self._data([record for _, record in placed[1:ends]], [at for at, _ in placed[1:ends]])
        self._checksums(placed[ends], placed[-1])
        self._summary(placed[ends + 1 : -1], placed[-1][1])

    def _placed(self) -> list[tuple[int, McapRecord]]:
        """Records and where they begin."""
        records = list(StreamReader(io.BytesIO(self.content), emit_chunks=True).records)
        at, places = len(MAGIC), []
        while at < len(self.content) - len(MAGIC):
            places.append(at)
            at += HEAD.size + HEAD.unpack_from(self.content, at)[1]
        return list(zip(places, records, strict=True))

    def _data(self, records: list[McapRecord], places: list[int]) -> None:
        indexed: dict[int, list[tuple[int, int]]] = {}
        for at, record in zip(places, records, strict=True):
            if not isinstance(record, MessageIndex):
                assert indexed == {}, "a chunk has messages that are in no index"
            if isinstance(record, Chunk):
                self.chunks[at] = record
                indexed = self._chunk(record)
            elif isinstance(record, MessageIndex):
                assert record.records == indexed.pop(record.channel_id)
            elif isinstance(record, Metadata):
                self.notes[at] = record
            else:
                assert isinstance(record, Schema | Channel)
                self._take(record)
        assert indexed == {}

    def _chunk(self, chunk: Chunk) -> dict[int, list[tuple[int, int]]]:
        """What is in a chunk; by channel, times and offsets of its messages."""
        records = breakup_chunk(chunk, validate_crc=True)
        assert chunk.uncompressed_crc
        index: dict[int, list[tuple[int, int]]] = {}
        for offset, record in zip(_offsets(chunk), records, strict=True):
            if isinstance(record, Message):
                index.setdefault(record.channel_id, []).append((record.log_time, offset))
            self._take(record)
        times = [t for entries in index.values() for t, _ in entries]
        assert (chunk.message_start_time, chunk.message_end_time) == (min(times), max(times))
        return index

    def _take(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            assert self.schemas.setdefault(record.id, record) == record
        elif isinstance(record, Channel):
            assert record.schema_id in self.schemas
            assert self.channels.setdefault(record.id, record) == record
        else:
            assert isinstance(record, Message)
            assert record.channel_id in self.channels
            self.counts[record.channel_id] += 1
            self.times.append(record.log_time)

    def _checksums(self, end: tuple[int, McapRecord], foot: tuple[int, McapRecord]) -> None:
        (end_at, data_end), (foot_at, footer) = end, foot
        assert isinstance(data_end, DataEnd)
        assert isinstance(footer, Footer)
        if data_end.data_section_crc:
            assert data_end.data_section_crc == zlib.crc32(self.content[:end_at])
        covered = self.content[footer.summary_start : foot_at + HEAD.size + 16]
        assert footer.summary_crc == zlib.crc32(covered) != 0

    def _summary(self, placed: list[tuple[int, McapRecord]], footer: McapRecord) -> None:
        assert isinstance(footer, Footer)
        assert placed[0][0] == footer.summary_start
        groups: dict[type[McapRecord], list[tuple[int, McapRecord]]] = {}
        for at, record in placed:
            groups.setdefault(type(record), []).append((at, record))
        repeated = [r for _, r in groups.get(Schema, []) + groups.get(Channel, [])]
        assert repeated == [*self.schemas.values(), *self.channels.values()]
        chunks = [r for _, r in groups[ChunkIndex] if isinstance(r, ChunkIndex)]
        assert [self._of(index) for index in chunks] == list(self.chunks.values())
        notes = [r for _, r in groups.get(MetadataIndex, []) if isinstance(r, MetadataIndex)]
        assert {(n.offset, n.name) for n in notes} == {(a, m.name) for a, m in self.notes.items()}
        ((_, told),) = groups[Statistics]
        assert isinstance(told, Statistics)
        assert told.channel_message_counts == dict(self.counts)
        assert told.message_count == len(self.times)
        assert (told.message_start_time, told.message_end_time) == (
            min(self.times),
            max(self.times),
        )
        assert (told.schema_count, told.channel_count) == (len(self.schemas), len(self.channels))
        assert (told.chunk_count, told.metadata_count) == (len(self.chunks), len(self.notes))
        assert groups[SummaryOffset][0][0] == footer.summary_offset_start
        for _, offset in groups[SummaryOffset]:
            assert isinstance(offset, SummaryOffset)
            if offset.group_length:  # the library lists empty groups too
                assert self.content[offset.group_start] == offset.group_opcode
                there = {a for a, _ in placed} | {groups[SummaryOffset][0][0]}
                assert offset.group_start + offset.group_length in there

    def _of(self, index: ChunkIndex) -> Chunk:
        """The chunk that an index points at, if all that it says is right."""
        chunk = self.chunks[index.chunk_start_offset]
        length = HEAD.unpack_from(self.content, index.chunk_start_offset)[1]
        assert index.chunk_length == HEAD.size + length
        assert index.compressed_size == len(chunk.data)
        same = ("compression", "uncompressed_size", "message_start_time", "message_end_time")
        assert all(getattr(index, name) == getattr(chunk, name) for name in same)
        for channel, at in index.message_index_offsets.items():
            stream = ReadDataStream(io.BytesIO(self.content[at + HEAD.size :]))
            assert MessageIndex.read(stream).channel_id == channel
        return chunk


def _offsets(chunk: Chunk) -> list[int]:
    """Where the records of a chunk begin in it."""
    stream, length = get_chunk_data_stream(chunk)
    assert length == chunk.uncompressed_size
    data, at, found = stream.read(length), 0, []
    while at < length:
        found.append(at)
        at += HEAD.size + HEAD.unpack_from(data, at)[1]
    return found


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lockstep log of several chunks."""
    path = tmp_path_factory.mktemp("log") / "log.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fleet.log.recorder.CHUNK_BYTES", 1 << 16)
        scenario = read_scenario("head_on", ["duration_s=60"]).scenario
        run_fleet(RunOptions(scenario, bus="memory", out=path), lambda _: None)
    return path


def as_it_is(log: Path, _: Path) -> Path:
    return log


def recovered(log: Path, folder: Path) -> Path:
    cut, out = folder / "cut.mcap", folder / "recovered.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    assert recover(cut, out).lost
    return out


def exported(log: Path, folder: Path) -> Path:
    out = folder / "foxglove.mcap"
    assert export(log, foxglove=True, out=out) == 0
    return out


@pytest.mark.parametrize("made", [as_it_is, recovered, exported])
def test_a_file_is_healthy(made: Callable[[Path, Path], Path], log: Path, tmp_path: Path) -> None:
    doctor = Doctor(made(log, tmp_path).read_bytes())
    doctor.examine()
    assert doctor.chunks
    assert doctor.times == sorted(doctor.times)


def test_the_doctor_sees_what_is_ill(log: Path) -> None:
    content = bytearray(log.read_bytes())
    foot = len(content) - len(MAGIC) - HEAD.size - 20
    content[foot + HEAD.size + 16] ^= 1
    with pytest.raises(AssertionError):
        Doctor(bytes(content)).examine()


def test_messages_on_two_topics_are_indexed_apart(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        for n in range(6):
            recorder.write(f"{n % 2 + 1}/truth", bytes(n + 1), n, n, n)
    doctor = Doctor(path.read_bytes())
    doctor.examine()
    assert doctor.counts == {1: 3, 2: 3}
