"""Tables of the command line: at 80 columns no word is broken, and none is lost."""

from __future__ import annotations

import re
import sys
from collections import Counter

import pytest
from rich.table import Table

from fleet.cli import main
from fleet.cli.screen import name_in_lines, side_by_side
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.support.mutants import MUTANTS, meeting

Patch = pytest.MonkeyPatch
Captured = pytest.CaptureFixture[str]

VOLUMES = [f"--volume=a_volume_of_{n}_m={n},{n}" for n in (500, 600, 700, 800)]
COMMANDS = {
    "check": ["check", "LOSSY", "MUTANT"],
    "metrics": ["metrics", "LOSSY"],
    "metrics of many volumes": ["metrics", "LOSSY", *VOLUMES],
    "compare": ["compare", "LOSSY", "MUTANT", "SECOND", "THIRD"],
    "info": ["info", "LOSSY"],
    "what if": ["repeat", "LOSSY", "--set", "seed=9", "--jitter", "250ms"],
}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Logs by name; their paths are longer than 80 columns."""
    folder = tmp_path_factory.mktemp("of-which-the-name-is-long") / ("long" * 20)
    folder.mkdir()
    lossy, mutant = folder / "lossy.mcap", folder / "mutant.mcap"
    plan = (Loss(probability=0.5), Latency(base_s=0.123456, jitter_s=0.0123456))
    run_fleet(RunOptions(meeting(*plan), bus="memory", out=lossy), lambda _: None)
    with pytest.MonkeyPatch.context() as patch:
        MUTANTS["highest ID"].patch(patch)
        run_fleet(RunOptions(meeting(), bus="memory", out=mutant), lambda _: None)
    logs = {"LOSSY": lossy, "MUTANT": mutant}
    for name in ("SECOND", "THIRD"):
        logs[name] = folder / f"{name}-log-of-the-lossy-run.mcap"
        logs[name].write_bytes(lossy.read_bytes())
    return {name: str(path) for name, path in logs.items()}


def words(command: list[str], columns: int, patch: Patch, captured: Captured) -> Counter[str]:
    """What a command prints at a width, without the lines of tables."""
    patch.setenv("COLUMNS", str(columns))
    patch.setattr(sys, "argv", ["fleet", *command])
    with pytest.raises(SystemExit):
        main()
    out = captured.readouterr().out
    assert max(map(len, [n for n in out.splitlines() if n[:1] in "┏┃┡│├└"])) <= columns
    return Counter(re.sub("[─-╿]", " ", out).split())


@pytest.mark.parametrize("case", COMMANDS)
def test_no_word_is_broken(
    case: str, logs: dict[str, str], monkeypatch: Patch, capsys: Captured
) -> None:
    command = [logs.get(word, word) for word in COMMANDS[case]]
    narrow, wide = (words(command, n, monkeypatch, capsys) for n in (80, 1000))
    once = {"all"} if case == "compare" else set()  # what is the same in all logs is told once
    assert once or wide - narrow == Counter()
    assert set(narrow) - once == set(wide)  # some tables are parted, their first columns repeated


def of_digits(picked: object) -> Table:
    """A table of some of five columns, each ten wide."""
    assert isinstance(picked, list)
    table = Table()
    for n in picked:
        table.add_column(str(n) * 10)
    return table


@pytest.mark.parametrize(
    ("width", "parts"), [(66, 1), (65, 2), (53, 2), (40, 2), (39, 4), (27, 4), (5, 4)]
)
def test_a_table_is_parted_where_its_words_do_not_fit(width: int, parts: int) -> None:
    tables = side_by_side(of_digits, 5, width)
    assert len(tables) == parts
    headings = [[column.header for column in table.columns] for table in tables]
    assert [h for part in headings for h in part[1:]] == [str(n) * 10 for n in range(1, 5)]
    assert {part[0] for part in headings} == {"0" * 10}


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("run", "run"),
        ("four_way-20261126-161500", "four_way-\n20261126-\n161500"),
        ("a/b/c-d_e.f", "a/b/c-d_e.f"),
        ("x" * 20, "x" * 20),
        ("", ""),
    ],
)
def test_long_names_are_parted_where_they_can_be(name: str, lines: str) -> None:
    assert name_in_lines(name, 14) == lines
