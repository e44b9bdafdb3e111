"""`fleet cat`, `fleet recover` and `fleet info`, as commands."""

from __future__ import annotations

import csv
import io
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

import fleet.log
from fleet.config.loading import read_scenario
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.conftest import Cli


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 12 s with conflicts."""
    out = tmp_path_factory.mktemp("log") / "run.mcap"
    loaded = read_scenario("head_on", ["duration_s=12", "resolution.horizon_s=60"])
    options = RunOptions(loaded.scenario, loaded.text, loaded.overrides, bus="memory", out=out)
    assert run_fleet(options, lambda _: None).status == "complete"
    return out


@pytest.fixture
def log(path: Path) -> fleet.log.Log:
    return fleet.log.open(path)


def out_of(cli: Cli, *arguments: str | Path, code: int = 0) -> str:
    """Standard output of a command that is to end so and say nothing else."""
    done = cli.run(*map(str, arguments))
    assert (done.returncode, done.stderr) == (code, "")
    return done.stdout


def complaint(cli: Cli, *arguments: str | Path) -> str:
    """The one line of a command that is used wrongly."""
    done = cli.run(*map(str, arguments))
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    return line


def test_ndjson_is_all_that_was_said(cli: Cli, path: Path, log: fleet.log.Log) -> None:
    lines = out_of(cli, "cat", path, "--format", "ndjson").splitlines()
    expected = [
        {"topic": topic, "log_ns": log_ns, **msgspec.to_builtins(message)}
        for topic, message, log_ns in log.messages()
    ]
    assert [json.loads(line) for line in lines] == json.loads(msgspec.json.encode(expected))
    assert len(lines) == sum(log.topics.values()) > 1000


@pytest.mark.parametrize("kind", ["truth", "adsb/0", "election", "delivery", "conflict", "done"])
def test_csv_is_read_back(cli: Cli, path: Path, log: fleet.log.Log, kind: str) -> None:
    out = out_of(cli, "cat", path, "--topics", f"*/{kind}", "--format", "csv")
    rows = list(csv.DictReader(io.StringIO(out)))
    columns = log.columns(f"*/{kind}")
    assert len(rows) == len(columns) > 0
    for name in columns.names:
        array = columns[name]
        if array.ndim == 2:
            for k in range(array.shape[1]):
                assert [float(row[f"{name}_{k}"]) for row in rows] == array[:, k].tolist()
        elif array.dtype != object:
            given = [v for v in array.tolist() if not math.isnan(v)]
            assert [json.loads(row[name]) for row in rows if row[name]] == given
        elif type(array[0]) is str:
            assert [row[name] for row in rows] == array.tolist()
        else:
            expected = json.loads(msgspec.json.encode(array.tolist()))
            assert [json.loads(row[name]) for row in rows] == expected


def test_text_is_a_line_a_message(cli: Cli, path: Path) -> None:
    lines = out_of(cli, "cat", path, "--topics", "1/truth", "--start", "1", "--end", "1.2s")
    first, second = lines.splitlines()
    assert first.startswith("1.000000 1/truth id=1 seq=10 t_ns=1000000000 position_ned_m=[")
    assert ' mode="plan" ' in second


@pytest.mark.parametrize(
    ("start", "end", "first", "last"),
    [
        ("", "", 0, 120),
        ("10", "11s", 100, 109),
        ("+2s", "+2500ms", 20, 24),
        ("-1s", "", 110, 120),
        ("-3s", "-1s", 90, 109),
        ("+0", "-10s", 0, 19),
        ("0.05min", "4", 30, 39),
    ],
)
def test_times_are_absolute_or_from_either_end(
    cli: Cli, path: Path, start: str, end: str, first: int, last: int
) -> None:
    times = [*(["--start", start] if start else []), *(["--end", end] if end else [])]
    out = out_of(cli, "cat", path, "--topics", "2/truth", "--format", "ndjson", *times)
    assert [json.loads(line)["seq"] for line in out.splitlines()] == [*range(first, last + 1)]


def test_an_end_before_the_start_is_said(cli: Cli, path: Path) -> None:
    line = complaint(cli, "cat", path, "--start", "+2s", "--end", "+500ms")
    assert "--end is not after --start: 0.5 s, 2 s" in line


def test_topics_are_chosen_and_excluded(cli: Cli, path: Path) -> None:
    choice = ["--topics", "1/**", "--topics", "sim/digest", "--exclude-topics", "*/delivery"]
    out = out_of(cli, "cat", path, *choice, "--end", "1", "--format", "ndjson")
    topics = {json.loads(line)["topic"] for line in out.splitlines()}
    assert topics >= {"1/adsb/0", "1/truth", "1/done", "sim/digest"}
    assert {topic for topic in topics if not topic.startswith("1/")} == {"sim/digest"}
    assert "1/delivery" not in topics


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--topics", "9/**"], "no topic is left; 'fleet info"),
        (["--format", "csv"], "csv is for messages of one class, and these are adsb, clock"),
        (["--start", "soon"], "'soon' is no time; write 300ms, 0.3s or 2min; or +10s, or -30s"),
        (["--end", "-x"], "'x' is no time"),
        (["--end", "--5"], "'-5' is no time"),
        (["--format", "xml"], "'xml' is not one of"),
    ],
)
def test_wrong_usage_is_one_line(cli: Cli, path: Path, arguments: list[str], says: str) -> None:
    assert says in complaint(cli, "cat", path, *arguments)


@pytest.mark.parametrize("command", ["cat", "recover", "info"])
def test_what_is_no_log_is_one_line(cli: Cli, tmp_path: Path, command: str) -> None:
    notes = tmp_path / "notes.txt"
    notes.write_text("# not a log\n", encoding="utf-8")
    assert f"{notes} is not an MCAP file" in complaint(cli, command, notes)
    assert "cannot read" in complaint(cli, command, tmp_path / "none.mcap")


def test_a_reader_that_goes_away_is_no_error(path: Path) -> None:
    command = [sys.executable, "-m", "fleet", "cat", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""


def test_damage_is_told_beside_the_messages(cli: Cli, path: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-1000])
    done = cli.run("cat", str(cut), "--topics", "1/truth")
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) == 121
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"fleet: warning: {cut}: its summary is missing or damaged")


# Recovery


def test_recovering_says_in_one_line_what_was_kept(cli: Cli, path: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    log.write_bytes(path.read_bytes())
    count = sum(fleet.log.open(log).topics.values())
    out = tmp_path / "run-recovered.mcap"
    kept = f"{out}: {count:,} messages up to 12 s kept, nothing lost\n"
    assert out_of(cli, "recover", log) == kept
    assert fleet.log.open(out).complete
    assert "exists already" in complaint(cli, "recover", log)
    assert out_of(cli, "recover", log, "--force") == kept


def test_what_was_lost_is_told_and_marked(cli: Cli, path: Path, tmp_path: Path) -> None:
    cut, out = tmp_path / "cut.mcap", tmp_path / "new.mcap"
    content = path.read_bytes()
    cut.write_bytes(content[: len(content) * 2 // 3])
    said = out_of(cli, "recover", cut, "--out", out, code=3)
    assert said.startswith(f"{out}: ")
    assert "kept, lost: the log has no end, because the run was killed or the file was cut" in said
    assert len(said.splitlines()) == 1
    told: dict[str, Any] = json.loads(out_of(cli, "info", out, "--json"))
    assert told["complete"] is False
    assert sum(told["messages"].values()) > 300
    assert "lost" not in cli.run("cat", str(out)).stdout
    assert "warning" in cli.run("cat", str(out)).stderr


def test_info_tells_of_damaged_files_what_can_be_read(cli: Cli, path: Path, tmp_path: Path) -> None:
    whole = json.loads(out_of(cli, "info", path, "--json"))
    changed = bytearray(path.read_bytes())
    log = tmp_path / "changed.mcap"
    changed[len(changed) // 2] ^= 1
    log.write_bytes(changed)
    told = json.loads(cli.run("info", str(log), "--json").stdout)
    assert told["complete"] is False
    assert told["metadata"] == whole["metadata"]
    assert 0 < sum(told["messages"].values()) <= sum(whole["messages"].values())
