"""Cut and changed logs: what is read is right, and what is missing is told."""

from __future__ import annotations

import random
import struct
import zlib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Metadata

import fleet.log
from fleet.config.loading import read_scenario
from fleet.errors import LogError
from fleet.log import Columns, Log
from fleet.log.container import MAGIC, DamagedError, sealed, unsealed
from fleet.log.reader import Record, Summary, read, summarise
from fleet.log.recorder import LogRecorder
from fleet.log.recovery import recover
from fleet.simulation.simulation import RunOptions, run_fleet

TRIALS = 200
RECORDER_CHUNK = 4000


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 6 s in many small chunks."""
    out = tmp_path_factory.mktemp("log") / "run.mcap"
    loaded = read_scenario("head_on", ["duration_s=6", "resolution.horizon_s=60"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fleet.log.recorder.CHUNK_BYTES", RECORDER_CHUNK)
        options = RunOptions(loaded.scenario, loaded.text, loaded.overrides, bus="memory", out=out)
        assert run_fleet(options, lambda _: None).status == "complete"
    return out


@pytest.fixture(scope="module")
def content(path: Path) -> bytes:
    return path.read_bytes()


@pytest.fixture(scope="module")
def whole(path: Path) -> dict[str, Columns]:
    return fleet.log.open(path).load()


@pytest.fixture(scope="module")
def records(path: Path) -> list[Record]:
    return list(read(path))


@pytest.fixture(scope="module")
def metadata(path: Path) -> dict[str, dict[str, str]]:
    return fleet.log.open(path).metadata


def quiet(path: Path) -> Log:
    return fleet.log.open(path, lambda _: None)


def assert_rows_of(found: dict[str, Columns], whole: dict[str, Columns]) -> int:
    """Each row is one of the original's, with all its values; returns how many there are."""
    for topic, columns in found.items():
        original = whole[topic]
        places = np.searchsorted(original.seq, columns.seq)
        assert (np.diff(places) > 0).all()
        for name in columns:
            assert columns[name].dtype == original[name].dtype
            wanted, where = original[name][places], f"{topic} {name}"
            np.testing.assert_array_equal(columns[name], wanted, where)
    return sum(map(len, found.values()))


class Judge:
    """Reads a changed file in all ways and compares with the original."""

    def __init__(
        self,
        path: Path,
        whole: dict[str, Columns],
        records: list[Record],
        metadata: dict[str, dict[str, str]],
    ) -> None:
        self.path = path
        self.whole = whole
        self.records = records
        self.metadata = metadata
        self.payloads = {(r.topic, r.seq): r.payload for r in records}

    def judge(self, content: bytes) -> tuple[Log, int] | None:
        """The log and how many of its messages can be read; None if it is said to be no log."""
        self.path.write_bytes(content)
        summary = Summary(self.path)
        try:
            prefix = list(read(self.path, summary))
            log = quiet(self.path)
        except LogError:
            return None
        assert prefix == self.records[: len(prefix)]
        assert summary.complete <= (len(prefix) == len(self.records))
        count = assert_rows_of(log.load(), self.whole)
        streamed = [(t, m) for t, m, _ in log.messages()]
        assert len(streamed) == count >= len(prefix)
        for topic, message in streamed:
            seq = getattr(message, "seq", None)
            key = topic, message.tick if seq is None else seq  # type: ignore[union-attr]
            assert msgspec.msgpack.encode(message) == self.payloads[key]
        for found in (log.metadata, summary.metadata):
            assert found.items() <= self.metadata.items()
        missing = count < len(self.records) or log.metadata != self.metadata
        assert not (missing and log.complete)
        assert log.verify().messages.total() == count
        return log, count


@pytest.fixture
def judge(
    tmp_path: Path,
    whole: dict[str, Columns],
    records: list[Record],
    metadata: dict[str, dict[str, str]],
) -> Judge:
    return Judge(tmp_path / "damaged.mcap", whole, records, metadata)


def test_the_log_is_worth_damaging(content: bytes, path: Path) -> None:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 20
    assert len(content) < 200_000


def test_the_whole_log_is_judged_whole(judge: Judge, content: bytes) -> None:
    found = judge.judge(content)
    assert found is not None
    assert found[0].complete
    assert found[1] == len(judge.records) > 500


def test_cut_anywhere_it_is_read_up_to_there(judge: Judge, content: bytes) -> None:
    rng, counts = random.Random(1), []
    for length in sorted(rng.randrange(len(content)) for _ in range(TRIALS)):
        found = judge.judge(content[:length])
        if found is None:
            assert length < 8000  # no whole chunk and no metadata
            continue
        log, count = found
        counts.append(count)
        assert not log.complete
        assert any("no end" in w or "summary" in w for w in log.warnings)
        if count < len(judge.records):
            assert f"read up to {log.end_ns / 1e9:g} s, {count:,} messages" in log.warnings[-1]
    assert len(counts) > TRIALS / 2
    assert counts == sorted(counts)
    assert counts[0] < 50
    assert counts[-1] > len(judge.records) - 50


@pytest.mark.parametrize("seed", range(4))
def test_with_any_byte_changed_only_what_it_touches_is_missing(
    judge: Judge, content: bytes, seed: int
) -> None:
    rng, readable = random.Random(seed), 0
    for _ in range(TRIALS // 4):
        place, mask = rng.randrange(len(content)), rng.randrange(1, 256)
        changed = bytearray(content)
        changed[place] ^= mask
        found = judge.judge(bytes(changed))
        if found is None:
            assert place < len(MAGIC)
            continue
        log, count = found
        readable += 1
        assert not log.complete, (place, mask)  # after verify() every changed byte is noticed
        assert count > len(judge.records) - 60  # one chunk at most
    assert readable > TRIALS / 4 - 3


@pytest.mark.parametrize("seed", range(4))
def test_cut_and_changed_it_is_still_never_wrong(judge: Judge, content: bytes, seed: int) -> None:
    rng, counts = random.Random(seed), []
    end = len(content) * 2 // 3
    for _ in range(TRIALS // 4):
        changed = bytearray(content[:end])
        for _ in range(3):
            changed[rng.randrange(end)] ^= 1 << rng.randrange(8)
        found = judge.judge(bytes(changed))
        if found is not None:
            assert not found[0].complete
            counts.append(found[1])
    assert len(counts) > TRIALS / 4 - 5
    assert sorted(counts)[len(counts) // 2] > len(judge.records) / 3


def test_a_changed_chunk_is_named_with_its_times(judge: Judge, content: bytes, path: Path) -> None:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    index = summary.chunk_indexes[5]
    changed = bytearray(content)
    changed[index.chunk_start_offset + 200] ^= 1
    judge.path.write_bytes(changed)
    log = fleet.log.open(judge.path)
    with pytest.warns(fleet.log.LogWarning) as told:
        assert len(log["1/truth"]) < 61
    (text,) = log.warnings
    assert text.startswith(f"the chunk at byte {index.chunk_start_offset:,} is damaged (")
    begin, end = index.message_start_time / 1e9, index.message_end_time / 1e9
    assert text.endswith(f": what was recorded from {begin:g} s to {end:g} s is missing")
    assert str(told.list[0].message) == f"{judge.path}: {text}"
    assert str(told.list[0].filename) == __file__


@pytest.mark.parametrize("opcode", range(20))
def test_a_chunk_that_seems_another_record_is_not_passed_over(
    judge: Judge, content: bytes, path: Path, opcode: int
) -> None:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    changed = bytearray(content[: len(content) // 2])
    changed[summary.chunk_indexes[4].chunk_start_offset] = opcode
    found = judge.judge(bytes(changed))
    assert found is not None
    assert len(found[0].warnings) == (1 if opcode == Opcode.CHUNK else 2)


def test_a_lying_message_index_is_not_believed(judge: Judge, content: bytes, path: Path) -> None:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    for index in summary.chunk_indexes[3:8]:
        begin = index.chunk_start_offset + index.chunk_length
        changed = bytearray(content)
        for at in range(begin, begin + index.message_index_length, 5):
            changed[at] ^= 0x11
        found = judge.judge(bytes(changed))
        assert found is not None
        assert found[1] == len(judge.records)
        assert "all messages are there" in found[0].warnings[0]
        # An index whose form is right, but which leaves out a message, is caught too.
        changed = bytearray(content)
        at = min(index.message_index_offsets.values())
        size = struct.unpack_from("<Q", content, at + 1)[0]
        changed[at + 9 + 6 + 8 : at + 9 + 6 + 16] = changed[at + 9 + size - 8 : at + 9 + size]
        found = judge.judge(bytes(changed))
        assert found is not None
        assert found[1] == len(judge.records)


def test_chunks_without_a_checksum_are_not_used(judge: Judge, content: bytes, path: Path) -> None:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    index, changed = summary.chunk_indexes[4], bytearray(content)
    at = index.chunk_start_offset + 9 + 24
    assert struct.unpack_from("<I", changed, at)[0] != 0
    changed[at : at + 4] = bytes(4)
    found = judge.judge(bytes(changed))
    assert found is not None
    assert "it has no checksum" in found[0].warnings[0]
    assert found[1] < len(judge.records)


def test_the_recorder_protects_all_parts(content: bytes) -> None:
    end = len(content) - 8 - 29
    begin, _, crc = struct.unpack_from("<QQI", content, end + 9)
    assert zlib.crc32(content[begin : end + 25]) == crc != 0
    assert struct.unpack_from("<I", content, begin - 4)[0] == zlib.crc32(content[: begin - 13]) != 0


def test_a_run_that_is_still_going_on_can_be_read(tmp_path: Path, records: list[Record]) -> None:
    path = tmp_path / "log.mcap"
    recorder = LogRecorder(path, overwrite=False)
    for r in records[:100]:
        recorder.write(r.topic, r.payload, r.seq, r.sent_ns, r.log_ns)
    recorder.metadata("part", {})
    for r in records[100:]:
        recorder.write(r.topic, r.payload, r.seq, r.sent_ns, r.log_ns)
    with pytest.warns(fleet.log.LogWarning, match="no end") as told:
        log = fleet.log.open(path)
    assert str(told.list[0].filename) == __file__
    assert sum(map(len, log.load().values())) == 100
    recorder.finish()
    assert fleet.log.open(path).complete


# Metadata


@pytest.mark.parametrize("values", [{}, {"a": "1", "b": ""}, {"checksum2": "crc"}])
def test_metadata_are_sealed(values: dict[str, str]) -> None:
    seal = sealed("run", values)
    assert unsealed(Metadata("run", seal)) == values
    assert unsealed(Metadata("run", values)) == values  # by a recorder of old
    for name, changed in [
        ("ruN", seal),
        ("run", {**seal, "a": "2"}),
        ("run", {**seal, "checksum": "crc33:00000000"}),
        ("run", {"Checksum": seal["checksum"], **values}),
    ]:
        with pytest.raises(DamagedError):
            unsealed(Metadata(name, changed))


# Recovery


def test_a_whole_log_is_recovered_as_it_is(
    judge: Judge, path: Path, records: list[Record], tmp_path: Path
) -> None:
    found = recover(path, tmp_path / "new.mcap")
    assert found.lost == []
    assert found.messages == len(records)
    assert found.until_ns == 6 * 10**9
    assert list(read(found.out)) == records
    again = judge.judge(found.out.read_bytes())
    assert again is not None
    assert again[0].complete
    old, new = summarise(path), summarise(found.out)
    assert (old.messages, old.metadata) == (new.messages, new.metadata)
    with path.open("rb") as one, found.out.open("rb") as two:
        before, after = make_reader(one).get_summary(), make_reader(two).get_summary()
        assert before is not None
        assert after is not None
        assert (before.schemas, before.channels) == (after.schemas, after.channels)


def test_what_is_recovered_is_what_could_be_read(
    judge: Judge, content: bytes, tmp_path: Path
) -> None:
    rng, lossy = random.Random(5), 0
    for n in range(60):
        changed = bytearray(content if n % 3 else content[: rng.randrange(9000, len(content))])
        if n % 3 or n % 2:
            changed[rng.randrange(8, len(changed))] ^= rng.randrange(1, 256)
        before = judge.judge(bytes(changed))
        assert before is not None
        found = recover(judge.path, tmp_path / "new.mcap", overwrite=True)
        kept, until_ns = found.messages, found.until_ns
        prefix = list(read(judge.path))
        after = judge.judge(found.out.read_bytes())
        assert after is not None
        assert after[1] == before[1] == kept
        assert after[0].end_ns >= until_ns
        assert after[0].metadata == before[0].metadata
        missing = kept < len(judge.records) or before[0].metadata != judge.metadata
        assert bool(found.lost) >= missing
        if n % 3:
            assert bool(found.lost) == missing
        # Whoever reads the new log is told the same, and `read` stops where it did.
        assert after[0].complete == (not found.lost)
        assert after[0].warnings == found.lost
        assert list(read(found.out)) == (prefix if found.lost else judge.records)
        lossy += bool(found.lost)
        with found.out.open("rb") as stream:  # other programs can read it
            assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == kept
    assert 20 < lossy < 60


def test_recovery_overwrites_nothing_unasked(path: Path, content: bytes, tmp_path: Path) -> None:
    out = tmp_path / "precious.mcap"
    out.write_bytes(b"precious")
    with pytest.raises(LogError, match="exists already"):
        recover(path, out)
    assert out.read_bytes() == b"precious"
    with pytest.raises(LogError, match="is a directory"):
        recover(path, tmp_path)
    with pytest.raises(LogError, match="is what is read"):
        recover(path, path, overwrite=True)
    assert path.read_bytes() == content
    with pytest.raises(LogError, match="cannot write"):
        recover(path, tmp_path / "missing" / "new.mcap")
    with pytest.raises(LogError, match="cannot read"):
        recover(tmp_path / "none.mcap", tmp_path / "new.mcap")
    with pytest.raises(LogError, match="not an MCAP file"):
        recover(out, tmp_path / "new.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["precious.mcap"]
