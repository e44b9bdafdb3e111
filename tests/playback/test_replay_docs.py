"""docs/replay.md names every option, and the commands shown there can be parsed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from fleet.cli import application

TEXT = (Path(__file__).parents[2] / "docs" / "replay.md").read_text(encoding="utf-8")
COMMANDS = typer.main.get_command(application([])).commands  # type: ignore[attr-defined]
SHOWN = re.findall(r"^fleet (replay|repeat) (.*?)(?:#.*)?$", TEXT, re.MULTILINE)


def test_every_option_of_replay_is_told() -> None:
    options = {o for p in COMMANDS["replay"].params for o in p.opts if o.startswith("-")}
    assert options - {"--help", "-h"} <= set(re.findall(r"`(-{1,2}[a-z-]+)", TEXT))


@pytest.mark.parametrize(("command", "line"), SHOWN)
def test_the_commands_shown_are_understood(command: str, line: str) -> None:
    COMMANDS[command].make_context(command, shlex.split(line))


def test_there_are_commands_shown() -> None:
    assert {command for command, _ in SHOWN} == {"replay", "repeat"}
    assert len(SHOWN) >= 6


@pytest.mark.parametrize(
    ("given", "hz"),
    [("x.mcap --clock", 40.0), ("--clock x.mcap", 40.0), ("--clock 25 x.mcap", 25.0)],
)
def test_the_clock_needs_no_number(given: str, hz: float) -> None:
    context = COMMANDS["replay"].make_context("replay", given.split())
    assert (context.params["clock"], str(context.params["log"])) == (hz, "x.mcap")
