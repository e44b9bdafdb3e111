"""Every reader meets every odd log with a result, or with a line that says what is wrong."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer.main

from fleet.analysis.recorded_run import RecordedRun
from fleet.cli import main
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan, Pilot
from fleet.report.paper import names_of
from fleet.report.run_data import run_data_of
from tests.support.odd_logs import ODD, base_log, scenario

Outcome = tuple[int, str, str]
Fleet = Callable[..., Outcome]

ALWAYS = [["check", "LOG"], ["metrics", "LOG"], ["report", "LOG", "--out", "OUT"]]
"""Commands that make the most of a log: every odd log is tried with them."""
IN_TURN = [
    ["repeat", "LOG", "--loss", "10%"],
    ["export", "LOG", "--foxglove", "--out", "OUT"],
    ["info", "LOG"],
    ["compare", "LOG", "BASE"],
    ["cat", "LOG"],
    ["repeat", "LOG"],
    ["export", "LOG", "--csv", "--out", "OUT"],
    ["recover", "LOG", "--out", "OUT"],
    ["info", "LOG", "--json"],
    ["metrics", "LOG", "--json"],
    ["cat", "LOG", "--format", "ndjson"],
]
"""Others, each with every eleventh odd log, and all with the worst."""
WORST = (
    "nothing",
    "no truth",
    "no metadata",
    "raw words",
    "unknown kind",
    "valid for ever",
    "foreign topics",
)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return base_log(tmp_path_factory.mktemp("logs") / "base.mcap")


@pytest.fixture
def fleet(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Fleet:
    """Run a command here: exit code, standard output and error."""
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr(typer.main, "get_command", _command)
    monkeypatch.setattr("fleet.report.page_parts.plotly_script", lambda: "")

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert isinstance(ended.value.code, int)
        return ended.value.code, *capsys.readouterr()

    return run


_command = functools.cache(typer.main.get_command)  # it takes longer to build than to run


def commands_of(name: str) -> list[list[str]]:
    turn = list(ODD).index(name) % len(IN_TURN)
    return ALWAYS + (IN_TURN if name in WORST else [IN_TURN[turn]])


@pytest.mark.parametrize("name", ODD)
def test_a_reader_meets_an_odd_log(name: str, base: Path, fleet: Fleet, tmp_path: Path) -> None:
    log = ODD[name](base, tmp_path / "odd.mcap")
    for n, command in enumerate(commands_of(name)):
        named = {"LOG": log, "BASE": base, "OUT": tmp_path / f"out{n}"}
        code, _, err = fleet(*(named.get(word, word) for word in command))
        assert code in ((0, 1, 2, 3) if command[0] == "recover" else (0, 1, 2)), command
        assert err.count("\n") <= 3, (command, err)
        assert all(line.startswith("fleet: ") for line in err.splitlines()), (command, err)
        assert err or code < 2 or command[0] == "check", command


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("no scenario", "holds no fleet run: its scenario is missing"),
        ("a UAV twice", "its scenario is not possible: uav: ID 1 is used more than once"),
        ("no UAV", "its scenario is not possible: uav: nobody flies"),
        ("no UAV, no fault", "its scenario is not possible: uav: nobody flies"),
        ("flying backwards", "no true state of any UAV is on record; there is nothing to draw"),
        ("overrides a number", "not understood (Expected `array`, got `int` - at `$.overrides`)"),
        ("versions nested", "at `$.versions[...]`"),
        ("deep scenario", "not understood (effective_scenario: "),
        ("plan of nobody", "not possible: fault[0].node: '999' names nobody"),
        ("announced plan deep", "not understood (a fault plan is nested too deeply)"),
        ("no truth", "no true state of any UAV is on record; there is nothing to draw"),
    ],
)
def test_what_is_wrong_is_said(
    name: str, says: str, base: Path, fleet: Fleet, tmp_path: Path
) -> None:
    log = ODD[name](base, tmp_path / "odd.mcap")
    code, out, err = fleet("report", log)
    assert (code, out) == (2, "")
    assert says in err.splitlines()[-1]


@pytest.mark.parametrize(
    ("name", "without"),
    [("unknown command", "commands"), ("one truth", "separation")],
)
def test_a_figure_that_has_nothing_to_show_is_not_drawn(
    name: str, without: str, base: Path, tmp_path: Path
) -> None:
    assert without in names_of(run_data_of(RecordedRun.of_log(base)))
    assert without not in names_of(
        run_data_of(RecordedRun.of_log(ODD[name](base, tmp_path / "odd.mcap")))
    )


@pytest.mark.parametrize(
    "name", ["elections of strangers", "member many times", "a stranger's broadcast", "no number"]
)
def test_what_cannot_be_of_a_run_is_left_out_and_found(
    name: str, base: Path, fleet: Fleet, tmp_path: Path
) -> None:
    log = ODD[name](base, tmp_path / "odd.mcap")
    code, out, _ = fleet("check", log)
    assert code == 1
    assert "a message is malformed, or cannot be of this run" in " ".join(out.split())
    code, _, err = fleet("report", log, "--out", tmp_path / "page.html")
    assert code == 0
    assert "messages are malformed, or not of this run" in err


def test_a_log_takes_no_longer_than_what_it_holds(
    base: Path, fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = scenario(tick_s=0.001, duration_s=86_400.0)(base, tmp_path / "day.mcap")
    follow, steps = Pilot.follow, 0

    def counting(
        pilot: Pilot, plan: FlightPlan, state: State, span_ns: int
    ) -> tuple[FlightPlan, list[State]]:
        nonlocal steps
        steps += 1
        assert steps < 30_000, "a day of flight, of which 1.5 s are on record"
        return follow(pilot, plan, state, span_ns)

    monkeypatch.setattr(Pilot, "follow", counting)
    for command in [c for c in [*ALWAYS, *IN_TURN] if c[0] != "repeat"]:
        steps, named = 0, {"LOG": log, "BASE": base, "OUT": tmp_path / f"day-{'-'.join(command)}"}
        assert fleet(*(named.get(word, word) for word in command))[0] in (0, 1), command
