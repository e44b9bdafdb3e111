"""`fleet metrics` and `fleet compare`: what they print, their files and their exit codes."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from fleet.analysis.metrics import RecordedRun, measure
from fleet.cli import main
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.log.recorder import LogRecorder
from fleet.simulation.simulation import RunOptions, run_fleet, run_metadata
from tests.support.mutants import meeting

Patch = pytest.MonkeyPatch
Captured = pytest.CaptureFixture[str]


def logged(path: Path, *plan: Any, **changes: Any) -> Path:
    """The log of a run in memory."""
    options = RunOptions(meeting(*plan, **changes), bus="memory", out=path)
    run_fleet(options, lambda _: None)
    return path


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return logged(tmp_path_factory.mktemp("logs") / "calm.mcap")


@pytest.fixture(scope="module")
def lossy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plan = (Loss(probability=0.5), Latency(base_s=0.2))
    return logged(tmp_path_factory.mktemp("logs") / "lossy.mcap", *plan, resolver="none", seed=7)


@pytest.fixture(scope="module")
def cut(calm: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log whose end is missing."""
    path = tmp_path_factory.mktemp("logs") / "cut.mcap"
    path.write_bytes(calm.read_bytes()[: int(0.97 * calm.stat().st_size)])
    return path


def fleet(patch: Patch, *arguments: str | Path) -> int:
    """Run the command here; its exit code."""
    patch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    code = ended.value.code
    assert isinstance(code, int)
    return code


def test_the_tables(calm: Path, monkeypatch: Patch, capsys: Captured) -> None:
    assert fleet(monkeypatch, "metrics", calm) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    for title in ("Pairs, nearest", "Alerts, nearest", "UAVs, farthest", "Delivery and latency"):
        assert title in captured.out
    assert "2 issued (2 transmissions), 2 applied, 0 unanswered" in captured.out
    assert max(map(len, captured.out.splitlines())) <= 80
    assert "…" not in captured.out


def test_as_json(calm: Path, monkeypatch: Patch, capsys: Captured) -> None:
    assert fleet(monkeypatch, "metrics", calm, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told.pop("log") == str(calm)
    assert told == measure(RecordedRun.of_log(calm)).as_dict()
    assert told["complete"] is True


def test_volumes(lossy: Path, monkeypatch: Patch, capsys: Captured) -> None:
    options = ("--volume", "near=500,60", "--volume", "touch=2,1", "--json")
    assert fleet(monkeypatch, "metrics", lossy, *options) == 0
    told = json.loads(capsys.readouterr().out)
    assert [v["name"] for v in told["volumes"]] == ["near", "touch"]
    assert told["volumes"][0] == {"name": "near", "horizontal_m": 500.0, "vertical_m": 60.0}
    assert [v["volume"] for v in told["pairs"][0]["volumes"]] == ["near", "touch"]


@pytest.mark.parametrize(
    "text", ["near", "near=5", "near=5,x", "=5,5", "near=-5,5", "near=5,nan", "a b=5,5", "n=1,2,3"]
)
def test_no_volume(text: str, calm: Path, monkeypatch: Patch, capsys: Captured) -> None:
    assert fleet(monkeypatch, "metrics", calm, "--volume", text) == 2
    assert "write nmac=152.4,30.48" in capsys.readouterr().err


def test_two_volumes_of_one_name(calm: Path, monkeypatch: Patch, capsys: Captured) -> None:
    options = ("--volume", "a=5,5", "--volume", "a=6,6")
    assert fleet(monkeypatch, "metrics", calm, *options) == 2
    assert "same name" in capsys.readouterr().err


def as_csv(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else str(value)


def test_csv(lossy: Path, tmp_path: Path, monkeypatch: Patch, capsys: Captured) -> None:
    folder = tmp_path / "a" / "b"
    assert fleet(monkeypatch, "metrics", lossy, "--csv", folder) == 0
    tables = measure(RecordedRun.of_log(lossy)).tables()
    assert {path.stem for path in folder.iterdir()} == set(tables)
    for name, rows in tables.items():
        with (folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
            found = list(csv.DictReader(file))
        blank = [{k: as_csv(v) for k, v in row.items()} for row in rows]
        assert found == blank
    assert len(tables["pairs"]) == 3
    assert fleet(monkeypatch, "metrics", lossy, "--csv", folder) == 2
    assert "exists already, not overwriting; use --force" in capsys.readouterr().err
    assert fleet(monkeypatch, "metrics", lossy, "--csv", folder, "--force") == 0


def test_csv_where_no_folder_can_be(calm: Path, monkeypatch: Patch, capsys: Captured) -> None:
    assert fleet(monkeypatch, "metrics", calm, "--csv", calm) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"fleet: {calm} is a file; name a folder"


def test_a_log_that_is_cut_is_measured_with_a_warning(
    cut: Path, monkeypatch: Patch, capsys: Captured
) -> None:
    assert fleet(monkeypatch, "metrics", cut, "--json") == 0
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert told["complete"] is False
    (line,) = captured.err.splitlines()
    assert line.startswith(f"fleet: {cut}: the run was not completed, or its log is damaged")
    assert line.endswith(f"measured up to {told['end_s']:g} s")


def test_a_log_without_messages(tmp_path: Path, monkeypatch: Patch, capsys: Captured) -> None:
    path = tmp_path / "x.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.metadata("run", run_metadata(RunOptions(meeting())))
    assert fleet(monkeypatch, "metrics", path) == 0
    assert "measured up to 0 s" in capsys.readouterr().err
    assert fleet(monkeypatch, "compare", path, path) == 0


@pytest.mark.parametrize("command", ["metrics", "compare"])
def test_no_fleet_log(command: str, tmp_path: Path, monkeypatch: Patch, capsys: Captured) -> None:
    path = tmp_path / "x.mcap"
    path.write_text("no log")
    assert fleet(monkeypatch, command, path) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", f"fleet: {path} is not an MCAP file\n")


def test_compare(calm: Path, lossy: Path, monkeypatch: Patch, capsys: Captured) -> None:
    assert fleet(monkeypatch, "compare", calm, lossy, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["logs"] == [str(calm), str(lossy)]
    assert told["settings"] == {
        "seed": [0, 7],
        "fault": [[], ["loss probability=0.5", "latency base_s=0.2"]],
        "resolver": ["geometric", "none"],
        "name": ["meeting", "meeting"],
    }
    assert list(told["settings"])[-1] == "name"  # what does not differ comes last
    runs = [measure(RecordedRun.of_log(log)) for log in (calm, lossy)]
    results = told["results"]
    assert results["least_separation"] == [r.totals.least_separation for r in runs]
    assert results["commands_issued"] == [2, 0]
    assert results["expected_ratio_adsb"] == pytest.approx([1.0, 0.5])
    assert results["delivery_ratio_cmd"] == [1.0, None]
    assert results["elections"] == [r.elections.terms for r in runs]
    assert results["incursions_nmac"] == [r.totals.incursions["nmac"] for r in runs]


def test_compare_settings_of_uavs(
    calm: Path, tmp_path: Path, monkeypatch: Patch, capsys: Captured
) -> None:
    shorter = logged(tmp_path / "short.mcap", duration_s=2.0)
    assert fleet(monkeypatch, "compare", calm, shorter) == 0
    out = capsys.readouterr().out
    lines = [line.strip("│ ").split("│")[0].strip() for line in out.splitlines()]
    assert lines.index("duration_s") < lines.index("least_separation")
    assert "the same in all: name meeting, seed 0, fault -" in " ".join(out.split())
    assert "calm" in out
    assert "short" in out
    assert "…" not in out


def test_logs_of_the_same_name_are_told_apart(
    calm: Path, monkeypatch: Patch, capsys: Captured
) -> None:
    assert fleet(monkeypatch, "compare", calm, calm) == 0
    out = capsys.readouterr().out
    assert "duration_s" not in out
    assert out.count("meeting") == 1


def test_whether_something_is_so_is_yes_or_no(
    calm: Path, cut: Path, monkeypatch: Patch, capsys: Captured
) -> None:
    assert fleet(monkeypatch, "compare", calm, cut) == 0
    rows = [line.strip("│ ").split() for line in capsys.readouterr().out.splitlines()]
    assert ["complete", "│", "yes", "│", "no"] in rows
    assert not [row for row in rows if {"True", "False"} & {*row}]


def test_many_logs_are_compared_in_80_columns(
    calm: Path, lossy: Path, tmp_path: Path, monkeypatch: Patch, capsys: Captured
) -> None:
    """A row a log for what was set, as many logs beside each other as fit, and the rest once."""
    logs = [tmp_path / f"run-{n}.mcap" for n in range(8)]
    for n, log in enumerate(logs):
        log.write_bytes((lossy if n % 2 else calm).read_bytes())
    monkeypatch.setenv("COLUMNS", "80")
    assert fleet(monkeypatch, "compare", *logs) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    told = " ".join(lines)
    assert [told.count(log.stem) for log in logs] == [2] * 8
    names = [line.strip("│ ").split("│")[0].strip() for line in lines]
    assert names.count("delivery_ratio_adsb") == 2
    assert names.count("complete") == names.count("pairs_alerted") == 1


def test_many_logs_that_are_alike_are_named_and_compared_once(
    calm: Path, tmp_path: Path, monkeypatch: Patch, capsys: Captured
) -> None:
    logs = [tmp_path / f"run-{n}.mcap" for n in range(8)]
    for log in logs:
        log.write_bytes(calm.read_bytes())
    monkeypatch.setenv("COLUMNS", "80")
    assert fleet(monkeypatch, "compare", *logs) == 0
    told = capsys.readouterr().out
    assert [told.count(log.stem) for log in logs] == [1] * 8
    assert told.count("least_separation") == told.count("altitude_deviation_max_m") == 1
