"""Topics that another program has added to a log: told, shown, exported; never taken for ours."""

from __future__ import annotations

import csv
import functools
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer.main
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

import fleet.log
from fleet.analysis.invariants import Verdict, check
from fleet.analysis.metrics import measure
from fleet.analysis.recorded_run import RecordedRun
from fleet.cli import main
from fleet.errors import LogError
from fleet.log.foreign import MAX_DECODED_BYTES, MAX_DEPTH, ForeignMessage, ForeignTopic
from fleet.log.reader import Summary, read, summarise
from fleet.log.recovery import recover
from tests.support.foreign_logs import Added, with_added
from tests.support.odd_logs import ESC, base_log
from tests.support.samples import pack

Outcome = tuple[int, str, str]
Fleet = Callable[..., Outcome]

BATTERY = [
    Added("7/battery", pack({"charge": 0.5 + n / 10, "cell": {"volts": 4, "id": "a"}}), t_s=n / 4)
    for n in range(4)
]
WEATHER = Added("weather", b'{"wind_mps": 3.5,\n "gusts": [1, 2]}', "json", "Weather", 0.6)
IMU = Added("/imu", bytes(range(40)), "cdr", "sensor_msgs/Imu", 0.7)
ADDED = [*BATTERY, WEATHER, IMU]
TOPICS = (
    ForeignTopic("/imu", "cdr", "sensor_msgs/Imu", 1),
    ForeignTopic("7/battery", "msgpack", "", 4),
    ForeignTopic("weather", "json", "Weather", 1),
)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return base_log(tmp_path_factory.mktemp("logs") / "base.mcap")


@pytest.fixture(scope="module")
def mixed(base: Path) -> Path:
    return with_added(base, base.with_name("mixed.mcap"), ADDED)


@pytest.fixture(scope="module")
def others(base: Path) -> Path:
    """A log of another program alone."""
    return with_added(None, base.with_name("others.mcap"), ADDED)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Fleet:
    """Run a command here: exit code, standard output and error."""
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr(typer.main, "get_command", _command)

    def command(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert isinstance(ended.value.code, int)
        return ended.value.code, *capsys.readouterr()

    return command


_command = functools.cache(typer.main.get_command)  # it takes longer to build than to run

# what is foreign


def test_a_log_tells_its_foreign_topics_apart(base: Path, mixed: Path) -> None:
    log = fleet.log.open(mixed)
    assert log.foreign == TOPICS
    assert log.topics == fleet.log.open(base).topics
    assert log.complete
    said = [(t, m) for t, m, _ in log.all_messages() if isinstance(m, ForeignMessage)]
    assert sorted(said, key=lambda row: row[0]) == sorted(
        ((a.topic, ForeignMessage(a.encoding, a.payload)) for a in ADDED), key=lambda row: row[0]
    )
    assert [*log.messages()] == [*fleet.log.open(base).messages()]
    times = [log_ns for *_, log_ns in log.all_messages()]
    assert times == sorted(times)


def test_a_run_is_without_them(base: Path, mixed: Path) -> None:
    with_them, without = RecordedRun.of_log(mixed), RecordedRun.of_log(base)
    assert with_them.foreign == TOPICS
    assert [*with_them.records] == [*without.records]
    assert measure(with_them) == measure(without)
    assert check(with_them) == check(without)


def test_a_reader_gives_them_if_asked(mixed: Path) -> None:
    summary = Summary(mixed)
    found = [record.topic for record in read(mixed, summary, foreign=True) if record.foreign]
    assert sorted(found) == sorted(a.topic for a in ADDED)
    assert summary.foreign == TOPICS
    assert summary.messages.total() + len(ADDED) == len([*read(mixed, foreign=True)])


@pytest.mark.parametrize(
    "added",
    [
        Added("1/adsb/0", b"{}", "json", "fleet.adsb"),
        Added("1/adsb/0", b"\x80"),
        Added("1/adsb/0", b"\x80", "msgpack", "other.Adsb"),
        Added("sim/clock", b"\x80", "msgpack", "rosgraph_msgs/Clock"),
        Added("99/truth", b"\x80", "cdr", "Truth"),
    ],
)
def test_a_topic_of_ours_with_data_of_others_is_refused(
    added: Added, base: Path, run: Fleet, tmp_path: Path
) -> None:
    log = with_added(base, tmp_path / "odd.mcap", [added])
    with pytest.raises(LogError, match=f"is not a fleet log: topic '{added.topic}' has messages"):
        fleet.log.open(log)
    with pytest.raises(LogError, match=f"topic '{added.topic}'"):
        list(read(log))
    for command in ("info", "cat", "check", "metrics"):
        code, out, err = run(command, log)
        assert (code, out) == (2, "")
        assert err.count("\n") == 1


def test_the_clock_of_another_program_is_foreign(tmp_path: Path) -> None:
    log = with_added(None, tmp_path / "x.mcap", [Added("/clock", b"", "cdr", "Clock")])
    assert [told.topic for told in fleet.log.open(log).foreign] == ["/clock"]


def test_an_unknown_class_with_a_schema_of_ours_is_still_found(base: Path, tmp_path: Path) -> None:
    added = [Added("1/gossip", b"\x80", "msgpack", "fleet.gossip")]
    found = check(RecordedRun.of_log(with_added(base, tmp_path / "x.mcap", added)))
    assert found.overall is Verdict.INVALID


def test_a_recovered_log_keeps_them(mixed: Path, tmp_path: Path) -> None:
    found = recover(mixed, tmp_path / "again.mcap")
    assert found.lost == []
    assert fleet.log.open(found.out).foreign == TOPICS


# commands


def test_info_lists_them(mixed: Path, others: Path, run: Fleet) -> None:
    code, out, err = run("info", mixed)
    assert (code, err) == (0, "")
    assert "Foreign topics, of other programs" in out
    assert "│ 7/battery │        4 │ msgpack  │ -               │" in out
    told = json.loads(run("info", mixed, "--json")[1])
    assert told["foreign"][0] == {
        "topic": "/imu", "encoding": "cdr", "schema": "sensor_msgs/Imu", "messages": 1,
    }  # fmt: skip
    assert "7/battery" not in told["messages"]
    code, out, err = run("info", others)
    assert (code, err) == (0, "")
    assert "none: another program has written this" in out
    assert "weather" in out
    assert summarise(others).foreign == TOPICS


def test_cat_prints_them(mixed: Path, run: Fleet) -> None:
    code, out, err = run("cat", mixed, "--topics", "7/battery,weather,/imu")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        '0.000000 7/battery charge=0.5 cell={"volts":4,"id":"a"}',
        '0.250000 7/battery charge=0.6 cell={"volts":4,"id":"a"}',
        '0.500000 7/battery charge=0.7 cell={"volts":4,"id":"a"}',
        "0.600000 weather wind_mps=3.5 gusts=[1,2]",
        f"0.700000 /imu cdr, 40 bytes: {bytes(range(32)).hex()}...",
        '0.750000 7/battery charge=0.8 cell={"volts":4,"id":"a"}',
    ]
    rows = run("cat", mixed, "--topics", "weather,/imu", "--format", "ndjson")[1].splitlines()
    weather, imu = map(json.loads, rows)
    assert weather == {
        "topic": "weather", "log_ns": 600_000_000, "encoding": "json",
        "value": {"wind_mps": 3.5, "gusts": [1, 2]},
    }  # fmt: skip
    assert imu["hex"] == bytes(range(40)).hex()
    code, out, err = run("cat", mixed, "--topics", "weather", "--format", "csv")
    assert (code, out) == (2, "")
    assert "'weather' is of another program" in err


def test_check_and_metrics_say_that_they_ignore_them(mixed: Path, others: Path, run: Fleet) -> None:
    says = f"fleet: {mixed}: ignored: 6 messages of 3 foreign topics (/imu, 7/battery, weather)\n"
    for command in (["check"], ["metrics"], ["compare"]):
        code, _, err = run(*command, mixed)
        assert code in (0, 2)
        assert err == says
    code, out, err = run("metrics", others)
    assert (code, out) == (2, "")
    assert "holds no fleet run" in err


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_export_makes_a_table_of_each(mixed: Path, run: Fleet, tmp_path: Path, form: str) -> None:
    code, _, err = run("export", mixed, f"--{form}", "--out", tmp_path / "t")
    assert code == 0
    assert err == (f"fleet: warning: {mixed}: left out of foreign messages: 1 of /imu in 'cdr'\n")
    rows = table(tmp_path / "t" / f"foreign_7_battery.{form}")
    assert [row["charge"] for row in rows] == [0.5, 0.6, 0.7, 0.8]
    assert rows[1]["cell.volts"] == 4
    assert rows[1]["cell.id"] == "a"
    assert rows[1]["log_ns"] == 250_000_000
    (weather,) = table(tmp_path / "t" / f"foreign_weather.{form}")
    assert (weather["wind_mps"], weather["gusts"]) == (3.5, "[1,2]")
    assert len(table(tmp_path / "t" / f"truth.{form}")) > 0


def table(path: Path) -> list[dict[str, Any]]:
    if path.suffix == ".parquet":
        parquet: Any = pytest.importorskip("pyarrow.parquet")
        found: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
        return found
    with path.open(encoding="utf-8", newline="") as file:
        return [{name: plain(text) for name, text in row.items()} for row in csv.DictReader(file)]


def plain(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def test_values_of_several_types_share_a_column(run: Fleet, tmp_path: Path) -> None:
    said = [
        {"a": 1, "b": 1, "c": True, "d": None, "log_ns": 1},
        {"a": 2.5, "b": "x", "c": None, "e.f": 1 << 63},
        [1, {"z": 2}],
    ]
    added = [Added("../etc/x", pack(value), t_s=n) for n, value in enumerate(said)]
    added.append(Added(".._etc_x", pack({"a": 1})))
    log = with_added(None, tmp_path / "x.mcap", added)
    for form in ("csv", "parquet"):
        assert run("export", log, f"--{form}", "--out", tmp_path / form)[0] == 0
        names = sorted(p.stem for p in (tmp_path / form).iterdir() if p.stem.startswith("foreign"))
        assert names == ["foreign_etc_x", "foreign_etc_x_2"]
    one, two, three = table(tmp_path / "parquet" / "foreign_etc_x.parquet")
    assert (one["a"], two["a"]) == (1.0, 2.5)
    assert (one["b"], two["b"]) == ("1", "x")
    assert (one["c"], one["d"], one["data.log_ns"]) == (True, None, 1)
    assert two["e.f"] == str(1 << 63)
    assert three["value"] == '[1,{"z":2}]'


# hostile messages

HOSTILE = {
    "deep": b"\x91" * (MAX_DEPTH + 1) + b"\xc0",
    "very deep": b"\x91" * 100_000 + b"\xc0",
    "a long list that is not there": b"\xdd\xff\xff\xff\xff",
    "cut": pack({"a": "text"})[:-2],
    "more behind": b"\x01\x02",
    "nothing": b"",
    "no type": b"\xc1",
    "no text": b"\xa1\xff",
    "no time": b"\xc7\x0d\xff" + b"\x01" * 13,
    "key a list": b"\x81\x91\x01\x02",
    "key a map": b"\x81\x81\x01\x02\x03",
    "a key twice": b"\x82\xa1a\x01\xa1a\x02",
    "a key twice as text": b"\x82\x01\x01\xa11\x02",
    "too large": pack("x" * MAX_DECODED_BYTES),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_cannot_be_decoded_is_named_and_shown_as_bytes(
    name: str, run: Fleet, tmp_path: Path
) -> None:
    payload = HOSTILE[name]
    with pytest.raises(ValueError, match=r"."):
        ForeignMessage("msgpack", payload).value()
    added = [Added("7/x", payload, t_s=1.5), Added("7/x", pack(5), t_s=2.0)]
    log = with_added(None, tmp_path / "x.mcap", added)
    code, out, err = run("cat", log)
    assert code == 0
    first, second = out.splitlines()
    assert first.startswith(f"1.500000 7/x msgpack, {len(payload)} bytes: {payload[:32].hex()}")
    assert second == "2.000000 7/x 5"
    (line,) = err.splitlines()
    assert line.startswith(f"fleet: warning: {log}: a message cannot be decoded: 7/x at 1.500000 s")
    assert line.endswith("; shown as bytes")
    code, _, err = run("export", log, "--csv", "--out", tmp_path / "t")
    assert code == 0
    assert "7/x at 1.500000 s" in err
    assert len(table(tmp_path / "t" / "foreign_7_x.csv")) == 1


@pytest.mark.parametrize(
    "payload", [b"{", b"\xff", b"[1]x", b"[" * 100_000, b"1e999", b'"\\ud800"']
)
def test_json_that_is_none_is_refused(payload: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        ForeignMessage("json", payload).value()


@pytest.mark.parametrize(
    ("payload", "value"),
    [
        (b"\xc4\x02\x00\xff", "0x00ff"),
        (b"\xd4\x05\xaa", "ext 5: 0xaa"),
        (b"\xd6\xff\x00\x00\x00\x02", 2_000_000_000),
        (b"\x82\x07\xc3\xc3\x01", {"7": True, "true": 1}),
        (b"\xcf" + b"\xff" * 8, (1 << 64) - 1),
        (b"\x91\xc0", [None]),
        (b"\x91" * MAX_DEPTH + b"\xc0", None),
    ],
)
def test_what_has_no_json_becomes_text(payload: bytes, value: Any) -> None:
    found = ForeignMessage("msgpack", payload).value()
    while value is None and found is not None:
        (found,) = found
    assert found == value


def test_numbers_too_large_for_others_are_text(run: Fleet, tmp_path: Path) -> None:
    assert ForeignMessage("json", b"[18446744073709551616]").value() == ["18446744073709551616"]
    log = with_added(None, tmp_path / "x.mcap", [Added("x", b"1" * 5000, "json")])
    assert run("cat", log)[0] == 0


def test_nothing_acts_on_a_terminal(run: Fleet, tmp_path: Path) -> None:
    added = [Added(ESC, pack({ESC: {ESC: ESC}, "\n\r": "\n"}), schema=ESC), Added(ESC, b"", ESC)]
    log = with_added(None, tmp_path / "x.mcap", added)
    for command in (["cat"], ["cat", "--format", "ndjson"], ["info"], ["info", "--json"]):
        code, out, err = run(command[0], log, *command[1:])
        assert code == 0
        assert not {"\x1b", "\x07", "\r", "\u202e", "\x00"} & set(out + err)
    assert len(run("cat", log)[1].splitlines()) == 2
    code, _, err = run("export", log, "--csv", "--out", tmp_path / "t")
    assert code == 0
    assert "\x1b" not in err


@given(st.binary(max_size=60), st.sampled_from(["msgpack", "json"]))
@settings(deadline=None, derandomize=True, max_examples=500)
def test_any_bytes_are_a_value_that_json_has_or_a_value_error(data: bytes, encoding: str) -> None:
    try:
        value = ForeignMessage(encoding, data).value()
    except ValueError as error:
        assert str(error)  # noqa: PT017 (any other error ends the test)
    else:
        json.dumps(value)


def test_messages_outside_of_chunks_are_not_left_out_in_silence(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        writer.add_message(writer.register_channel("x", "json", 0), 1, b"1", 1)
        writer.finish()
    with pytest.raises(LogError, match="its messages are not in chunks"):
        fleet.log.open(path)
