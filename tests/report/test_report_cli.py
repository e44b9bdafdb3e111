"""`fleet report`: files, names, and what it refuses."""

from __future__ import annotations

import shutil
import sys
from functools import partial
from pathlib import Path

import pytest

from fleet.errors import LogError, MissingExtraError

pytest.importorskip("plotly")
pytest.importorskip("matplotlib")

from fleet.cli.report import flown_in_memory, report
from fleet.report.page_parts import plotly_script
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.agents.test_speed import overtaking
from tests.conftest import Cli
from tests.support.report_samples import log_of

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log in a folder of its own."""
    path = tmp_path / "run.mcap"
    shutil.copy(log_of("four_way", "duration_s=100"), path)
    return path


def test_the_page_is_written_beside_the_log_and_never_over_a_file(log: Path) -> None:
    assert report(log) == 0
    page = log.with_suffix(".html")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    page.write_text("mine", encoding="utf-8")
    with pytest.raises(LogError, match="exists already, not overwriting; use --force"):
        report(log)
    assert page.read_text(encoding="utf-8") == "mine"
    assert report(log, force=True) == 0
    assert page.stat().st_size > 1e6


def test_figures_have_the_numbers_of_the_paper_or_the_name_of_the_scenario(log: Path) -> None:
    folder = log.parent / "figures"
    assert report(log, png=folder, dpi=50) == 0
    assert sorted(p.name for p in folder.iterdir()) == [
        "figure_09.png",
        "figure_10.png",
        "four_way_candidates.png",
        "four_way_commands.png",
        "four_way_plan.png",
        "four_way_separation.png",
    ]
    assert all(p.read_bytes().startswith(PNG) for p in folder.iterdir())
    assert not log.with_suffix(".html").exists()
    with pytest.raises(LogError, match="exists already"):
        report(log, png=folder, dpi=50)


def test_a_run_in_which_a_speed_is_commanded_is_drawn(tmp_path: Path) -> None:
    """All on one line at one altitude: nothing has a width, and nobody turns or climbs."""
    log, folder = tmp_path / "overtaking.mcap", tmp_path / "figures"
    run_fleet(RunOptions(overtaking(duration_s=30.0), bus="memory", out=log), lambda _: None)
    assert report(log, png=folder, dpi=50) == 0
    assert {p.stem for p in folder.iterdir()} >= {"overtaking_commands", "overtaking_plan"}
    assert report(log) == 0
    assert "Speed (m/s)" in log.with_suffix(".html").read_text(encoding="utf-8")


def test_the_papers_figures_come_from_one_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shorter = partial(flown_in_memory, overrides=("duration_s=50",))
    monkeypatch.setattr("fleet.cli.report.flown_in_memory", shorter)
    assert report(paper=tmp_path / "figures", dpi=50) == 0
    drawn = sorted((tmp_path / "figures").iterdir())
    assert [p.name for p in drawn] == [f"figure_{n:02d}.png" for n in range(3, 11)]
    assert all(p.read_bytes().startswith(PNG) for p in drawn)


def test_a_damaged_log_is_drawn_and_said_to_be(cli: Cli) -> None:
    whole = log_of("four_way", "duration_s=100").read_bytes()
    (cli.folder / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    done = cli.run("report", "cut.mcap", "--out", "page.html")
    assert done.returncode == 0
    assert "cut.mcap: This log is damaged or cut short." in done.stderr
    assert "class='damage'" in (cli.folder / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "name a log, or use --paper DIR"),
        (["x.mcap", "--paper", "d"], "--paper flies its own runs"),
        (["missing.mcap"], "cannot read missing.mcap"),
    ],
)
def test_wrong_usage_is_one_line(cli: Cli, arguments: list[str], complaint: str) -> None:
    done = cli.run("report", *arguments)
    assert done.returncode == 2
    assert complaint in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_missing_extra_is_named(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'zenoh-fleet\[report\]'"):
        plotly_script()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match="a figure needs the library 'matplotlib'"):
        report(log, png=log.parent / "figures")
