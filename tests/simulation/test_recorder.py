"""The log: what is written is read back, also if the end of the file is missing."""

from __future__ import annotations

import contextlib
import json
import random
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator, ValidationError
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.writer import Writer

from fleet.analysis.recorded_run import RecordedRun
from fleet.errors import LogError
from fleet.log.reader import Record, Summary, read, summarise
from fleet.log.recorder import LogRecorder
from fleet.log.schema import json_schema
from fleet.protocol.classes import MESSAGES
from fleet.protocol.codec import decode, encode
from fleet.protocol.messages import Clock, Digest, Late, Message
from fleet.protocol.topics import CLOCK as CLOCK_TOPIC
from fleet.protocol.topics import DIGEST as DIGEST_TOPIC
from fleet.protocol.topics import topic_of
from tests.support.samples import CLOCK, DIGEST, SAMPLES, any_message, pack, unpack

fast = settings(deadline=None, derandomize=True, max_examples=40)
METADATA = {"scenario": "head_on", "seed": "7", "text": "naïve\n[[uav]]\n"}


def record_of(message: Message, log_ns: int) -> Record:
    return Record(topic_of(message), encode(message), message.seq, message.t_ns, log_ns)


def write(recorder: LogRecorder, record: Record) -> None:
    recorder.write(record.topic, record.payload, record.seq, record.sent_ns, record.log_ns)


def log_of_samples(path: Path) -> None:
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.metadata("run", METADATA)
        for message in SAMPLES:
            write(recorder, record_of(message, message.t_ns + 5))
        recorder.write(CLOCK_TOPIC, encode(CLOCK), 10, CLOCK.t_ns, CLOCK.t_ns)
        recorder.write(DIGEST_TOPIC, encode(DIGEST), 10, DIGEST.t_ns, DIGEST.t_ns)


@given(st.lists(st.tuples(any_message(), st.integers(0, 2**63)), max_size=30))
@fast
def test_what_was_written_is_read_back(run: list[tuple[Message, int]]) -> None:
    # The format has 32 bits for the sequence number; the payload has all of it.
    written = [record_of(message, log_ns) for message, log_ns in run]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.mcap")
        with LogRecorder(path, overwrite=False) as recorder:
            for record in written:
                write(recorder, record)
        found = list(read(path))
    assert [(r.topic, r.payload, r.sent_ns, r.log_ns) for r in found] == [
        (r.topic, r.payload, r.sent_ns, r.log_ns) for r in written
    ]
    assert [r.seq for r in found] == [r.seq % 2**32 for r in written]


def test_the_order_of_writing_is_kept_across_topics_and_times(tmp_path: Path) -> None:
    written = [record_of(Late(uav, k, k, k), 9 - k) for k in range(9) for uav in (3, 1, 2)]
    with LogRecorder(tmp_path / "log.mcap", overwrite=False) as recorder:
        for record in written:
            write(recorder, record)
    assert list(read(tmp_path / "log.mcap")) == written


def test_the_summary_tells_what_the_log_holds(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    log_of_samples(path)
    summary = summarise(path)
    payloads = [*map(encode, SAMPLES), encode(CLOCK), encode(DIGEST)]
    assert summary.complete
    assert set(summary.messages.values()) == {1}
    assert set(summary.messages) == {*map(topic_of, SAMPLES), CLOCK_TOPIC, DIGEST_TOPIC}
    assert summary.payload_bytes == sum(map(len, payloads))
    assert summary.metadata == {"run": METADATA}
    assert summary.first_ns == SAMPLES[0].t_ns + 5
    assert summary.last_ns == max(m.t_ns for m in SAMPLES) + 5


# Schemas


def channels(path: Path) -> list[tuple[Channel, Schema]]:
    with path.open("rb") as stream:
        found = make_reader(stream).get_summary()
    assert found is not None
    return [(c, found.schemas[c.schema_id]) for c in found.channels.values()]


def test_every_channel_says_how_to_read_it(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    log_of_samples(path)
    payloads = {r.topic: r.payload for r in read(path)}
    found = channels(path)
    assert {c.topic for c, _ in found} == set(payloads)
    for channel, schema in found:
        assert (channel.message_encoding, schema.encoding) == ("msgpack", "jsonschema")
        root = json.loads(schema.data)
        assert root["type"] == "object"
        assert "$ref" not in schema.data.decode()
        Draft202012Validator.check_schema(root)
        Draft202012Validator(root).validate(unpack(payloads[channel.topic]))


@pytest.mark.parametrize("cls", [*MESSAGES, Clock, Digest], ids=lambda c: c.kind)
def test_a_schema_describes_each_field_and_no_other(cls: type[Message | Clock | Digest]) -> None:
    schema = json_schema(cls)
    assert schema["type"] == "object"
    assert schema["title"] == f"fleet.{cls.__name__}"
    assert list(schema["properties"]) == list(cls.__struct_fields__)
    assert schema["additionalProperties"] is False


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda m: m.kind)
def test_a_schema_rejects_what_the_codec_rejects(sample: Message) -> None:
    validator = Draft202012Validator(json_schema(type(sample)))
    plain: dict[str, Any] = unpack(encode(sample))
    validator.validate(plain)
    required = {f.name for f in msgspec.structs.fields(type(sample)) if f.required}
    assert {"id", "seq", "t_ns"} <= required
    for name in plain:
        without = {n: v for n, v in plain.items() if n != name}
        wrong = [{**plain, name: None}, {**plain, "extra": 1}]
        if name in required:
            wrong.append(without)
        else:
            validator.validate(without)  # that columns belong together no schema can say
        for value in wrong:
            with pytest.raises(ValidationError):
                validator.validate(value)
            with pytest.raises(ValueError):  # noqa: PT011
                decode(topic_of(sample), pack(value))


@given(message=any_message())
@fast
def test_every_message_satisfies_its_schema(message: Message) -> None:
    validator = VALIDATORS[type(message)]
    validator.validate(unpack(encode(message)))


VALIDATORS = {cls: Draft202012Validator(json_schema(cls)) for cls in MESSAGES}


# Files


def test_an_existing_file_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(LogError, match="exists already"):
        LogRecorder(path, overwrite=False)
    assert path.read_bytes() == b"precious"


def test_an_existing_file_is_overwritten_on_request(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    log_of_samples(path)
    with LogRecorder(path, overwrite=True) as recorder:
        recorder.metadata("run", {})
    assert summarise(path).messages == {}


@pytest.mark.parametrize("name", ["", "missing/log.mcap"])
def test_a_file_that_cannot_be_made_is_said_to_be(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogError, match=r"cannot write|is a directory"):
        LogRecorder(tmp_path / name, overwrite=True)


@pytest.mark.parametrize("name", ["", "missing.mcap"])
def test_a_file_that_cannot_be_read_is_said_to_be(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogError, match="cannot read"):
        list(read(tmp_path / name))


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"# not a log\n", bytes(100)])
def test_what_is_not_mcap_is_said_to_be(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(LogError, match="not an MCAP file"):
        list(read(path))


def test_the_log_of_another_program_is_no_run(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("sensor_msgs/Imu", "ros2msg", b"float64 x")
        channel = writer.register_channel("/imu", "cdr", schema)
        writer.add_message(channel, 0, b"", 0)
        writer.finish()
    assert [topic.topic for topic in summarise(path).foreign] == ["/imu"]
    with pytest.raises(LogError, match="holds no fleet run"):
        RecordedRun.of_log(path)


def test_an_mcap_file_without_a_run_is_said_to_be(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    with pytest.raises(LogError, match="holds no fleet run"):
        summarise(path)


def test_metadata_is_read_back_and_the_last_of_a_name_counts(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.metadata("run", METADATA)
        recorder.metadata("result", {"status": "running"})
        recorder.metadata("result", {"status": "complete", "why": ""})
    found = summarise(path).metadata
    assert found == {"run": METADATA, "result": {"status": "complete", "why": ""}}


def test_finishing_twice_is_finishing_once(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        write(recorder, record_of(Late(1, 0, 0, 1), 0))
        recorder.finish()
        size = path.stat().st_size
    assert path.stat().st_size == size
    assert summarise(path).complete


def test_an_error_in_the_run_still_finishes_the_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"

    def broken_run() -> None:
        with LogRecorder(path, overwrite=False) as recorder:
            write(recorder, record_of(Late(1, 0, 0, 1), 0))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        broken_run()
    assert summarise(path).complete


# Files whose end is missing


def flushed_log(path: Path) -> tuple[list[Record], list[tuple[int, int]]]:
    """A log in several chunks: its records, and (size, records) at each flush."""
    written: list[Record] = []
    flushes: list[tuple[int, int]] = []
    with LogRecorder(path, overwrite=False) as recorder:
        for k in range(5):
            recorder.metadata(f"part {k}", METADATA)
            flushes.append((path.stat().st_size, len(written)))
            for n, message in enumerate(SAMPLES):
                written.append(record_of(message, 100 * k + n))
                write(recorder, written[-1])
    flushes.append((path.stat().st_size, len(written)))
    return written, flushes


def test_a_cut_file_is_read_up_to_a_last_whole_record(tmp_path: Path) -> None:
    written, flushes = flushed_log(tmp_path / "log.mcap")
    content = (tmp_path / "log.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    edges = {min(size + d, len(content)) for size, _ in flushes for d in (-1, 0, 1)}
    for length in sorted(edges.union(range(0, len(content), 31))):
        path.write_bytes(content[:length])
        summary = Summary(path)
        try:
            found = list(read(path, summary))
        except LogError:
            assert length < 8
            continue
        assert found == written[: len(found)]
        assert len(found) >= max((n for size, n in flushes[:-1] if size <= length), default=0)
        assert summary.complete == (length == len(content))
        assert summary.messages.total() == len(found)


def test_a_log_whose_writer_was_killed_is_read_up_to_its_last_flush(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    recorder = LogRecorder(path, overwrite=False)
    flushed = [record_of(message, 0) for message in SAMPLES]
    for record in flushed:
        write(recorder, record)
    recorder.metadata("part", {})
    write(recorder, record_of(Late(1, 9, 9, 9), 9))
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(path.read_bytes())
    recorder.finish()
    summary = Summary(copy)
    assert list(read(copy, summary)) == flushed
    assert not summary.complete


def test_a_log_is_flushed_about_once_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr("fleet.log.recorder.time.monotonic", lambda: now_s[0])
    path = tmp_path / "log.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        sizes = []
        for k in range(6):
            now_s[0] += 0.4
            write(recorder, record_of(Late(1, k, k, k), k))
            sizes.append(len(list(read(path))) if path.stat().st_size else 0)
    assert sizes == [0, 0, 3, 3, 3, 6]


@pytest.mark.parametrize("mask", [0x04, 0x80])
def test_a_damaged_file_is_read_up_to_the_damage(tmp_path: Path, mask: int) -> None:
    written, flushes = flushed_log(tmp_path / "log.mcap")
    content = (tmp_path / "log.mcap").read_bytes()
    path = tmp_path / "damaged.mcap"
    (begin, before), (end, _) = flushes[2:4]
    for place in [*range(begin, begin + 150), *range(begin + 150, end, 7)]:
        damaged = bytearray(content)
        damaged[place] ^= mask
        path.write_bytes(damaged)
        found = list(read(path))
        assert found[:before] == written[:before]
        assert all(record in written for record in found)


# A full disk

FULL = Path("/dev/full")
full_disk = pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux only")


def flushing(recorder: LogRecorder) -> None:
    recorder.metadata("run", METADATA)


def much(recorder: LogRecorder) -> None:
    """More than one chunk."""
    record = Record("1/late", random.Random(0).randbytes(100_000), 0, 0, 0)
    for _ in range(20):
        write(recorder, record)


def little(recorder: LogRecorder) -> None:
    write(recorder, record_of(Late(1, 0, 0, 1), 0))


@full_disk
@pytest.mark.parametrize("part", [little, much, flushing])
def test_a_full_disk_is_a_log_error(part: Callable[[LogRecorder], None]) -> None:
    recorder = LogRecorder(FULL, overwrite=True)
    try:
        with pytest.raises(LogError, match="No space left"), recorder:
            part(recorder)
    finally:
        with contextlib.suppress(OSError):
            recorder._file.close()
