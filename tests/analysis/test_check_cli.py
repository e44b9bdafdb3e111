"""`fleet check`: its verdicts, its exit codes and what it prints."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from fleet.cli import main
from fleet.config.scenario import Scenario
from fleet.faults.kinds.loss import Loss
from fleet.log.recorder import LogRecorder
from fleet.simulation.simulation import RunOptions, run_fleet, run_metadata
from tests.support.mutants import MUTANTS, meeting


def logged(path: Path, scenario: Scenario) -> Path:
    """The log of a run in memory."""
    run_fleet(RunOptions(scenario, bus="memory", out=path), lambda _: None)
    return path


def fleet(*arguments: str | Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run the command here; its exit code."""
    monkeypatch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    code = ended.value.code
    assert isinstance(code, int)
    return code


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return logged(tmp_path_factory.mktemp("logs") / "good.mcap", meeting())


@pytest.fixture(scope="module")
def bad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a mutant."""
    mutant = MUTANTS["highest ID"]
    with pytest.MonkeyPatch.context() as patch:
        mutant.patch(patch)
        return logged(tmp_path_factory.mktemp("logs") / "bad.mcap", mutant.scenario)


@pytest.fixture(scope="module")
def cut(good: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first half of a log."""
    path = tmp_path_factory.mktemp("logs") / "cut.mcap"
    path.write_bytes(good.read_bytes()[: good.stat().st_size // 2])
    return path


def test_a_good_log(
    good: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fleet("check", good, monkeypatch=monkeypatch) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[-1] == f"{good}: valid"
    assert "2 commands obeyed" in out


def test_a_bad_log(
    bad: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fleet("check", bad, monkeypatch=monkeypatch) == 1
    assert capsys.readouterr().out.splitlines()[-4:] == [
        "lowest eligible leads: the lowest eligible is 1, not UAV 3",
        "  0.200 s  coordinator/election  term=4 members=1,2,3 computing=3",
        "  0.000 s  1/adsb/0  seq=0 heard_s=0.100",
        f"{bad}: invalid",
    ]


def test_a_log_that_is_cut(
    cut: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fleet("check", cut, monkeypatch=monkeypatch) == 2
    assert "cut short" in capsys.readouterr().out.splitlines()[-1]


def test_invalid_wins_over_unknown_over_valid(
    good: Path, bad: Path, cut: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert fleet("check", good, good, monkeypatch=monkeypatch) == 0
    assert fleet("check", cut, good, monkeypatch=monkeypatch) == 2
    assert fleet("check", cut, bad, good, monkeypatch=monkeypatch) == 1


def test_as_json(
    good: Path, bad: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fleet("check", "--json", good, bad, monkeypatch=monkeypatch) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "invalid"
    assert [(log["log"], log["verdict"]) for log in told["logs"]] == [
        (str(good), "valid"),
        (str(bad), "invalid"),
    ]
    broken = [i for i in told["logs"][1]["invariants"] if i["verdict"] == "invalid"]
    assert [i["name"] for i in broken] == ["lowest eligible leads"]
    assert broken[0]["witnesses"][0] == {
        "t_ns": 200_000_000,
        "topic": "coordinator/election",
        "fields": {"term": 4, "members": [1, 2, 3], "computing": 3},
    }


def test_no_fleet_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.mcap"
    path.write_text("no log")
    assert fleet("check", path, monkeypatch=monkeypatch) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", f"fleet: {path} is not an MCAP file\n")


@pytest.mark.parametrize(
    ("metadata", "says"),
    [({}, "holds no fleet run"), ({"effective_scenario": "{}"}, "its scenario is not understood")],
)
def test_a_log_without_a_scenario(
    metadata: dict[str, str],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "x.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.metadata("run", metadata)
    assert fleet("check", path, monkeypatch=monkeypatch) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line


def test_a_run_that_was_not_completed_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.mcap"
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.metadata("run", run_metadata(RunOptions(meeting(Loss(probability=1.0)))))
        recorder.metadata("result", {"status": "interrupted"})
    assert fleet("check", path, monkeypatch=monkeypatch) == 2
