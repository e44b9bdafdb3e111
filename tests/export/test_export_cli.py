"""`fleet export` and `fleet view` as they are typed."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fleet.cli import main
from fleet.config.loading import read_scenario
from fleet.log.reader import summarise
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.conftest import Cli


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short log."""
    path = tmp_path_factory.mktemp("log") / "short.mcap"
    scenario = read_scenario("head_on", ["duration_s=5"]).scenario
    assert (
        run_fleet(RunOptions(scenario, bus="memory", out=path), lambda _: None).status == "complete"
    )
    return path


@pytest.fixture
def log(logged: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy of it, in an empty folder; the log is as it was afterwards."""
    path = tmp_path / "short.mcap"
    path.write_bytes(logged.read_bytes())
    yield path
    assert path.read_bytes() == logged.read_bytes()
    assert not list(tmp_path.glob(".*"))  # nothing is left half written


def fleet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: object
) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    monkeypatch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    out, err = capsys.readouterr()
    code = ended.value.code
    return (code if isinstance(code, int) else 0), out, err


Run = Any


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """`fleet` in this process."""
    return lambda *arguments: fleet(monkeypatch, capsys, *arguments)


@pytest.mark.parametrize(
    ("option", "name"), [("--foxglove", "short.foxglove.mcap"), ("--csv", "short_csv")]
)
def test_exports_stand_beside_the_log_and_are_not_overwritten(
    log: Path, run: Run, option: str, name: str
) -> None:
    code, out, err = run("export", log, option)
    assert (code, err) == (0, "")
    assert out.startswith(f"{log.parent / name}: ")
    code, _, err = run("export", log, option)
    assert code == 2
    assert "not overwriting; use --force" in err
    assert run("export", log, option, "--force")[0] == 0


def test_an_export_goes_where_it_is_told(log: Path, run: Run, tmp_path: Path) -> None:
    assert run("export", log, "--foxglove", "--out", tmp_path / "a.mcap")[0] == 0
    assert (tmp_path / "a.mcap").stat().st_size > 1000
    code, _, err = run("export", log, "--foxglove", "--out", tmp_path / "no" / "a.mcap")
    assert (code, err.count("\n")) == (2, 1)
    assert "cannot write" in err


@pytest.mark.parametrize("options", [(), ("--csv", "--foxglove")])
def test_exactly_one_format_is_chosen(log: Path, run: Run, options: tuple[str, ...]) -> None:
    code, _, err = run("export", log, *options)
    assert code == 2
    assert "choose one of --foxglove, --rerun, --csv and --parquet" in err


def test_an_export_is_not_taken_for_a_run(log: Path, run: Run, tmp_path: Path) -> None:
    run("export", log, "--foxglove", "--out", tmp_path / "a.mcap")
    summary = summarise(tmp_path / "a.mcap")
    assert not summary.messages
    assert "/tf" in [topic.topic for topic in summary.foreign]
    code, _, err = run("check", tmp_path / "a.mcap")
    assert code == 2
    assert "holds no fleet run" in err


@pytest.mark.parametrize(
    ("command", "library", "extra"),
    [
        (("export", "--rerun"), "rerun", "rerun"),
        (("export", "--parquet"), "pyarrow", "parquet"),
        (("view",), "rerun", "rerun"),
        (("view", "--web", "--no-open"), "rerun", "rerun"),
    ],
)
def test_a_missing_extra_is_named_with_the_command_that_installs_it(
    log: Path,
    run: Run,
    monkeypatch: pytest.MonkeyPatch,
    command: tuple[str, ...],
    library: str,
    extra: str,
) -> None:
    present = importlib.import_module

    def absent(name: str, package: str | None = None) -> Any:
        if name.partition(".")[0] == library:
            raise ModuleNotFoundError(name)
        return present(name, package)

    monkeypatch.setattr(importlib, "import_module", absent)
    monkeypatch.setenv("DISPLAY", ":0")
    code, _, err = run(command[0], log, *command[1:])
    assert (code, err.count("\n")) == (2, 1)
    assert f"pip install 'zenoh-fleet[{extra}]'" in err
    assert [path.name for path in log.parent.iterdir()] == [log.name]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_without_a_display_a_window_is_not_tried(
    log: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    code, _, err = run("view", log)
    assert (code, err.count("\n")) == (2, 1)
    assert "there is no display here; use --web" in err


@pytest.mark.parametrize(
    "command", ["export --foxglove", "export --rerun", "report", "recover", "repeat"]
)
def test_what_is_read_is_never_overwritten(
    log: Path, run: Run, command: str, tmp_path: Path
) -> None:
    link = tmp_path / "link.mcap"
    link.symlink_to(log)
    name, *options = command.split()
    for out in (log, link):
        more = () if name == "recover" else options
        code, _, err = run(name, log, *more, "--out", out, "--force")
        assert (code, err.count("\n")) == (2, 1)
        assert "is what is read; name another" in err


def test_what_is_missing_of_a_damaged_log_is_said(log: Path, run: Run) -> None:
    whole = log.read_bytes()
    log.write_bytes(whole[:-2000])
    code, out, err = run("export", log, "--csv")
    assert (code, err.count("\n")) == (0, 1)
    assert "its summary is missing" in err
    assert "short_csv: " in out
    code, _, err = run("export", log, "--foxglove")
    assert (code, err.count("\n")) == (0, 1)
    assert "its log is damaged; shown up to" in err
    log.write_bytes(whole)


@pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="needs the extra rerun")
def test_view_web_serves_until_it_is_interrupted(log: Path, cli: Cli) -> None:
    process = cli.start("view", str(log), "--web", "--no-open")
    assert process.stderr is not None
    assert process.stderr.readline().startswith("http://127.0.0.1:")
    process.send_signal(2)
    _, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (0, "")
    assert not cli.members(process)
