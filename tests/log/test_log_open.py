"""What `fleet.log.open` gives: columns, messages, and no more reading than is asked for."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

import fleet.log
from fleet.config.loading import read_scenario
from fleet.errors import LogError, MissingExtraError
from fleet.log import Log, contents
from fleet.log.chunk import Messages
from fleet.log.contents import ChunkSpan, Contents
from fleet.log.foreign import ForeignTopic
from fleet.log.reader import Record, read, summarise
from fleet.log.recorder import LogRecorder
from fleet.log.topics import chosen, matcher
from fleet.protocol.codec import decode, decode_clock, kind_of
from fleet.protocol.messages import Late, Truth
from fleet.protocol.topics import CLOCK, DIGEST, topic_of
from fleet.simulation.simulation import RunOptions, run_fleet

UAVS = (1, 2)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 40 s that has conflicts, in many small chunks."""
    out = tmp_path_factory.mktemp("log") / "run.mcap"
    loaded = read_scenario("head_on", ["duration_s=40"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fleet.log.recorder.CHUNK_BYTES", 20_000)
        options = RunOptions(loaded.scenario, loaded.text, loaded.overrides, bus="memory", out=out)
        assert run_fleet(options, lambda _: None).status == "complete"
    return out


@pytest.fixture
def log(path: Path) -> Log:
    return fleet.log.open(path)


@pytest.fixture(scope="module")
def records(path: Path) -> list[Record]:
    return list(read(path))


def plain(record: Record) -> dict[str, Any]:
    if record.topic == DIGEST:
        return dict(msgspec.msgpack.decode(record.payload))
    message = (
        decode_clock(record.payload)
        if record.topic == CLOCK
        else decode(record.topic, record.payload)
    )
    return dict(msgspec.to_builtins(message))


# Columns


def test_columns_hold_what_was_recorded(log: Log, records: list[Record]) -> None:
    loaded = log.load()
    assert loaded.keys() == {r.topic for r in records} == log.topics.keys()
    for topic, columns in loaded.items():
        rows = [(r, plain(r)) for r in records if r.topic == topic]
        assert len(columns) == len(rows) == log.topics[topic]
        assert columns.log_ns.tolist() == [r.log_ns for r, _ in rows]
        assert columns.t_ns.tolist() == [r.sent_ns for r, _ in rows]
        assert columns.seq.tolist() == [values.get("seq", r.seq) for r, values in rows]
        for name in rows[0][1]:
            found = columns[name]
            values = [
                tuple(value.tolist()) if isinstance(value, np.ndarray) else value for value in found
            ]
            assert values == [row[name] for _, row in rows]


def test_columns_have_types_and_shapes(log: Log) -> None:
    truth, adsb = log["1/truth"], log["1/adsb/0"]
    n = len(truth)
    assert n == 401
    assert truth.position_ned_m.shape == truth.velocity_ned_mps.shape == (n, 3)
    assert truth.position_ned_m.dtype == truth.speed_mps.dtype == np.float64
    for name in ("t_ns", "log_ns", "seq", "id", "waypoint_index"):
        assert truth[name].shape == (n,)
        assert truth[name].dtype == np.int64
    assert adsb.arrived.dtype == bool
    assert set(truth.mode) >= {"plan"}
    assert all(type(mode) is str for mode in truth.mode)
    assert log["coordinator/election"].members.tolist()[0] == (1, 2)
    assert log["sim/clock"].expected[1]["adsb/0"] == ((1, 0), (2, 0))
    assert set(truth.names) == {"log_ns", *Truth.__struct_fields__}
    assert "position_ned_m" in dir(truth)
    assert "401 messages of class truth" in repr(truth)


def test_one_topic_is_the_same_however_it_is_asked_for(log: Log) -> None:
    alone, of_all = log.columns("2/truth"), log.load()["2/truth"]
    assert log["2/truth"] is log["2/truth"]
    for name in alone:
        np.testing.assert_array_equal(alone[name], of_all[name], name)
        np.testing.assert_array_equal(alone[name], log["2/truth"][name], name)


def test_a_key_expression_gives_topics_together_in_the_order_of_the_log(log: Log) -> None:
    both = log.columns("*/truth")
    assert both.id.tolist() == [1, 2] * 401
    assert (both.rows(both.id == 2).position_ned_m == log["2/truth"].position_ned_m).all()
    assert (np.diff(both.t_ns) >= 0).all()


def test_a_range_of_times_has_its_begin_and_not_its_end(log: Log) -> None:
    whole = log["1/truth"]
    part = log.columns("1/truth", start_s=10, end_s=20)
    assert part.t_ns.tolist() == [n * 10**8 for n in range(100, 200)]
    assert (part.position_ned_m == whole.position_ned_m[100:200]).all()
    assert len(log.columns("1/truth", end_s=0)) == 0
    assert len(log.columns("1/truth", start_s=40)) == 1
    assert len(log.columns("1/truth", start_s=41)) == 0
    assert len(log.columns("1/truth", start_s=-5, end_s=0.05)) == 1
    assert log.load("1/cmd/**", start_s=39)["1/cmd/2"].heading_rad.shape == (0,)


def test_what_is_not_there_is_named(log: Log) -> None:
    with pytest.raises(LogError, match=r"no topic is '7/truth'; there are 1/adsb/0, 1/cmd"):
        log.columns("7/truth")
    with pytest.raises(LogError, match="several classes"):
        log.columns("1/**")
    with pytest.raises(AttributeError, match=r"class truth have no 'height', but t_ns"):
        _ = log["1/truth"].height
    with pytest.raises(KeyError, match="have no 'height'"):
        log["1/truth"]["height"]


def test_one_knows_what_was_flown(log: Log, path: Path) -> None:
    assert log.scenario == read_scenario("head_on", ["duration_s=40"]).scenario
    assert log.metadata["result"]["status"] == "complete"
    assert log.metadata == summarise(path).metadata
    assert "checksum" not in log.metadata["run"]
    assert (log.start_ns, log.end_ns) == (0, 40 * 10**9)
    assert log.complete
    assert log.warnings == []
    assert "complete" in repr(log)


def test_a_log_without_a_scenario_says_so(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.write("1/late", b"", 0, 0, 0)
    log = fleet.log.open(path)
    with pytest.raises(LogError, match="scenario is missing"):
        _ = log.scenario
    with LogRecorder(path, overwrite=True) as recorder:
        recorder.metadata("run", {"effective_scenario": "{}", "fleet_version": "9.9"})
    with pytest.raises(LogError, match=r"not understood .* 9\.9"):
        _ = fleet.log.open(path).scenario


# Messages


def test_messages_come_in_the_order_of_the_log(log: Log, records: list[Record]) -> None:
    found = list(log.messages())
    assert [(t, ns) for t, _, ns in found] == [(r.topic, r.log_ns) for r in records]
    assert [msgspec.to_builtins(m) for _, m, _ in found] == [plain(r) for r in records]


def test_messages_are_chosen_by_topic_and_time(log: Log) -> None:
    found = [(t, m.t_ns) for t, m, _ in log.messages(["*/truth", "1/adsb/*"], 10, 10.15)]
    assert [t for t, _ in found] == ["1/adsb/0", "1/truth", "2/truth", "1/truth", "2/truth"]
    assert {t for t, _, _ in log.messages("coordinator/*")} >= {"coordinator/heartbeat"}
    assert list(log.messages("9/**")) == []


def test_messages_that_cannot_be_decoded_are_told(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    good = [Late(1, k, k, k) for k in range(20)]
    with LogRecorder(path, overwrite=False) as recorder:
        for message in good:
            payload = msgspec.msgpack.encode(message)
            recorder.write(topic_of(message), payload, message.seq, message.t_ns, 0)
            recorder.write(topic_of(message), payload[:-1], message.seq, message.t_ns, 0)
    with pytest.warns(fleet.log.LogWarning, match=r"20 messages of class late are left out"):
        assert fleet.log.open(path)["1/late"].seq.tolist() == [*range(20)]
    with pytest.warns(fleet.log.LogWarning, match="20 messages of 1/late are left out"):
        assert [m for _, m, _ in fleet.log.open(path).messages()] == good


# Reading no more than is needed


@pytest.fixture
def chunks_read(monkeypatch: pytest.MonkeyPatch) -> list[ChunkSpan]:
    found: list[ChunkSpan] = []
    plainly = Contents.read

    def read(self: Contents, file: IO[bytes], span: ChunkSpan) -> Messages:
        found.append(span)
        return plainly(self, file, span)

    monkeypatch.setattr(Contents, "read", read)
    return found


def test_opening_reads_no_chunk(path: Path, chunks_read: list[ChunkSpan]) -> None:
    log = fleet.log.open(path)
    assert log.scenario.name == "head_on"
    assert len(log.topics) > 10
    assert chunks_read == []


def test_a_range_of_times_reads_only_its_chunks(path: Path, chunks_read: list[ChunkSpan]) -> None:
    log = fleet.log.open(path)
    log.columns("1/truth", start_s=20, end_s=21)
    assert 1 <= len(chunks_read) <= 4
    assert all(s.first_ns < 21 * 10**9 and s.last_ns >= 20 * 10**9 for s in chunks_read)
    chunks_read.clear()
    log["1/truth"]
    assert len(chunks_read) > 20


def test_a_topic_reads_only_chunks_that_have_it(path: Path, chunks_read: list[ChunkSpan]) -> None:
    log = fleet.log.open(path)
    assert len(log["1/decision"]) >= 1
    assert 1 <= len(chunks_read) <= 1 + len(log["1/decision"])


def test_all_topics_are_loaded_in_one_pass(path: Path, chunks_read: list[ChunkSpan]) -> None:
    fleet.log.open(path).load()
    assert len(chunks_read) == len(set(chunks_read))


def test_the_index_of_messages_is_used(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(_: bytes) -> Messages:
        raise AssertionError

    monkeypatch.setattr("fleet.log.chunk._along_the_chain", never)
    assert len(fleet.log.open(path)["1/truth"]) == 401


# Key expressions


@pytest.mark.parametrize(
    ("expression", "topic", "included"),
    [
        ("1/truth", "1/truth", True),
        ("1/truth", "2/truth", False),
        ("*/truth", "2/truth", True),
        ("*/truth", "2/adsb/0", False),
        ("*", "2/truth", False),
        ("1/*", "1/adsb/0", False),
        ("1/**", "1/adsb/0", True),
        ("1/**", "1", True),
        ("1/**", "11/truth", False),
        ("**", "2/cmd/3", True),
        ("**/3", "2/cmd/3", True),
        ("**/cmd/**", "2/cmd/3", True),
        ("**/cmd/**", "2/ack/3", False),
        ("2/**/3", "2/cmd/3", True),
    ],
)
def test_key_expressions(expression: str, topic: str, included: bool) -> None:
    assert matcher(expression)(topic) is included


def test_topics_are_chosen_and_excluded() -> None:
    topics = ["1/adsb/0", "1/truth", "2/truth", "sim/clock"]
    assert chosen(topics, []) == topics
    assert chosen(topics, ["1/**", "sim/*"], ["*/truth"]) == ["1/adsb/0", "sim/clock"]


# Frames


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_frame_has_a_column_for_each_number(log: Log, library: Any) -> None:
    pytest.importorskip(library)
    columns = log["1/truth"]
    frame = columns.frame(library)
    assert list(frame.columns)[:7] == [
        "t_ns", "log_ns", "seq", "id", "position_ned_m_0", "position_ned_m_1", "position_ned_m_2",
    ]  # fmt: skip
    assert (frame["position_ned_m_1"].to_numpy() == columns.position_ned_m[:, 1]).all()
    assert list(frame["mode"]) == columns.mode.tolist()


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_every_class_makes_a_frame(log: Log, library: Any) -> None:
    pytest.importorskip(library)
    for topic, columns in log.load().items():
        assert len(columns.frame(library)) == log.topics[topic]


def test_maps_lose_nothing_in_polars(log: Log) -> None:
    pytest.importorskip("polars")
    columns = log["sim/clock"]
    found = columns.frame("polars")["expected"].to_list()
    assert [{i["key"]: i["value"] for i in item} for item in found] == [
        {topic: [[*one] for one in listed] for topic, listed in item.items()}
        for item in columns.expected
    ]


def test_a_frame_without_its_library_says_how_to_get_it(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    columns = log["1/truth"]
    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(
        MissingExtraError, match=r"needs .* 'pandas', .* pip install 'zenoh-fleet\[analysis\]'"
    ):
        columns.frame()
    with pytest.raises(ValueError, match="'excel' is not"):
        columns.frame("excel")  # type: ignore[arg-type]


# Other files


def test_a_missing_file_is_said_to_be(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot read"):
        fleet.log.open(tmp_path / "none.mcap")
    with pytest.raises(LogError, match="cannot read"):
        fleet.log.open(tmp_path)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"# not a log\n" * 99, bytes(1000)])
def test_what_is_not_mcap_is_said_to_be(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(LogError, match="not an MCAP file"):
        fleet.log.open(path)


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.NONE])
@pytest.mark.parametrize("schema", ["sensor_msgs/Imu", ""])
def test_the_log_of_another_program_is_listed_or_refused(
    tmp_path: Path, chunked: bool, finished: bool, compression: CompressionType, schema: str
) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=chunked, compression=compression)
        writer.start("ros2")
        id_ = writer.register_schema(schema, "ros2msg", b"float64 x") if schema else 0
        channel = writer.register_channel("/imu", "cdr", id_)
        for n in range(100):
            writer.add_message(channel, n, bytes(n), n)
        writer.finish() if finished else writer.flush()
    if not chunked:
        with pytest.raises(LogError, match="not in chunks" if finished else "not a fleet log"):
            fleet.log.open(path)
        return
    (told,) = summarise(path).foreign
    assert told == ForeignTopic("/imu", "cdr", schema, 100)
    assert summarise(path).complete == finished


def test_a_log_by_a_writer_without_indexes_is_read_too(tmp_path: Path, path: Path) -> None:
    copy = tmp_path / "plain.mcap"
    rewrite(path, copy, use_statistics=False, repeat_channels=False)
    with pytest.warns(fleet.log.LogWarning, match="summary is missing or damaged; read without"):
        log = fleet.log.open(copy)
    assert len(log["1/truth"]) == 401


def rewrite(path: Path, copy: Path, **options: Any) -> None:
    """The same messages by another writer."""
    with path.open("rb") as source:
        schemas = [s.name for s in contents.contents_of(path, source).schemas.values()]
    with copy.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start("fleet")
        ids = {name: writer.register_schema(name, "jsonschema", b"{}") for name in schemas}
        channels: dict[str, int] = {}
        for r in read(path):
            if r.topic not in channels:
                schema = ids[f"fleet.{kind_of(r.topic)}"]
                channels[r.topic] = writer.register_channel(r.topic, "msgpack", schema)
            writer.add_message(channels[r.topic], r.log_ns, r.payload, r.sent_ns, r.seq)
        writer.finish()
