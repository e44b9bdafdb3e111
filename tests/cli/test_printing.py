"""Nothing reaches a terminal but what can be seen, whatever a log says."""

from __future__ import annotations

import io
import json
import sys
import unicodedata
from pathlib import Path

import pytest
from rich.table import Table

from fleet.cli.screen import Screen
from fleet.printing import PrintableStream, printable, printable_streams
from tests.log.test_odd_logs import Fleet, fleet
from tests.support.odd_logs import ESC, ODD, base_log

__all__ = ["fleet"]

UNASSIGNED = {0x2065, *range(0x13439, 0x13440), *range(0xE0000, 0xE0080)}
"""Format characters of later versions of Unicode, or kept for such."""
UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def test_exactly_what_unicode_calls_unseen_is_escaped() -> None:
    for code in range(sys.maxunicode + 1):
        unseen = unicodedata.category(chr(code)) in UNSEEN or code in UNASSIGNED
        assert (printable(chr(code)) != chr(code)) is unseen, hex(code)


@pytest.mark.parametrize("text", [ESC, "a\U000e0041b", "\x7f\x9f\u2028", "plain", "né\n\t"])
def test_escapes_are_those_of_json(text: str) -> None:
    assert json.loads(f'"{printable(text)}"'.replace("\\u005c", "\\")) == text


def test_layout_stays_on_the_way_to_a_stream() -> None:
    out = io.StringIO()
    stream = PrintableStream(out)
    print("a\tb\x1b[2J\r", file=stream)
    stream.writelines(["c\n"])
    assert out.getvalue() == "a\tb\\u001b[2J\\u000d\nc\n"
    assert not stream.isatty()


def test_a_table_keeps_its_colours_and_loses_those_of_its_text() -> None:
    out = io.StringIO()
    table = Table("[red]one[/]")
    table.add_row("[green]ok[/]")
    table.add_row("\x1b[31m\u202ered")
    screen = Screen(force_terminal=True, width=60, color_system="standard")
    screen.file = out
    screen.print(table)
    assert "\x1b[32mok\x1b[0m" in out.getvalue()
    assert "\\u001b[31m\\u202ered" in out.getvalue()
    assert "\x1b[31m\u202e" not in out.getvalue()


def test_the_streams_are_as_before_afterwards() -> None:
    before = sys.stdout, sys.stderr
    with printable_streams(), printable_streams():
        assert isinstance(sys.stdout, PrintableStream)
        assert sys.stdout.raw is before[0]
    assert (sys.stdout, sys.stderr) == before


COMMANDS = [
    ["check", "LOG"],
    ["metrics", "LOG"],
    ["compare", "LOG", "LOG"],
    ["report", "LOG", "--out", "OUT"],
    ["repeat", "LOG"],
    ["repeat", "LOG", "--loss", "10%"],
    ["info", "LOG"],
    ["info", "LOG", "--json"],
    ["cat", "LOG"],
    ["cat", "LOG", "--format", "ndjson"],
    ["cat", "LOG", "--format", "csv", "--topics", "*/truth"],
    ["export", "LOG", "--csv", "--out", "OUT"],
    ["export", "LOG", "--foxglove", "--out", "OUT"],
    ["recover", "LOG", "--out", "OUT"],
    ["replay", "LOG"],
]
RAW = [name for name in ODD if name.startswith("raw ") or "unknown" in name]


@pytest.mark.parametrize("name", RAW)
def test_nothing_of_a_log_reaches_the_terminal_raw(name: str, fleet: Fleet, tmp_path: Path) -> None:
    base = base_log(tmp_path / "base.mcap")
    log = ODD[name](base, tmp_path / "odd.mcap")
    turn = RAW.index(name)
    chosen = COMMANDS if name == "raw words" else COMMANDS[turn % 3 :: 3]
    for n, command in enumerate(chosen):
        if command[0] == "replay" and name != "raw versions":
            continue
        named = {"LOG": log, "OUT": tmp_path / f"out{n}"}
        _, out, err = fleet(*(named.get(word, word) for word in command))
        raw = {c for c in out + err if unicodedata.category(c) in UNSEEN} - {"\n", "\t"}
        assert not raw, (command, raw)
    page = tmp_path / "out3"
    if name == "raw words":
        assert "<script>alert" not in page.read_text()


def test_ndjson_says_the_same_as_the_log(fleet: Fleet, tmp_path: Path) -> None:
    log = ODD["unknown mode"](base_log(tmp_path / "base.mcap"), tmp_path / "odd.mcap")
    _, out, _ = fleet("cat", log, "--topics", "1/truth", "--format", "ndjson")
    assert {json.loads(line)["mode"] for line in out.splitlines()} == {ESC[:60]}
