"""What is kept of chunks is packed, and the summary of a log is the same for it."""

from __future__ import annotations

import sys
from io import BytesIO

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from fleet.log.chunk_indices import PackedChunkIndices, keep_packed

CHUNKS, TOPICS = 30, 100


def written(*, packing: bool) -> tuple[bytes, Writer]:
    """A log of some chunks, each with messages of many topics, in another order each time."""
    file = BytesIO()
    writer = Writer(file, compression=CompressionType.ZSTD)
    if packing:
        keep_packed(writer)
    writer.start("fleet", "a test")
    schema = writer.register_schema("x", "", b"")
    channels = [writer.register_channel(f"{n}/x", "msgpack", schema) for n in range(TOPICS)]
    for chunk in range(CHUNKS):
        for n in range(TOPICS):
            writer.add_message(channels[(7 * n + chunk) % TOPICS], 10**9 * chunk, b"x" * n, 2**62)
        writer.flush()
    writer.finish()
    return file.getvalue(), writer


def test_the_log_is_the_same() -> None:
    plain, packed = written(packing=False)[0], written(packing=True)[0]
    assert packed == plain
    summary = make_reader(BytesIO(packed)).get_summary()
    assert summary is not None
    assert [len(index.message_index_offsets) for index in summary.chunk_indexes] == [
        TOPICS
    ] * CHUNKS


def test_a_chunk_takes_little(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    append = PackedChunkIndices.append

    def measured(self: PackedChunkIndices, index: object) -> None:
        append(self, index)  # type: ignore[arg-type]
        sizes.append(sum(map(sys.getsizeof, (self._packed[-1], self._packed[-1][1]))))

    monkeypatch.setattr(PackedChunkIndices, "append", measured)
    written(packing=True)
    assert len(sizes) == CHUNKS
    assert max(sizes) < 8 * TOPICS
