"""The command line imports what one command needs, and knows all of them."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest
import typer

from fleet.cli import COMMANDS, application


def commands_of(app: typer.Typer) -> list[str]:
    return list(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


@pytest.mark.parametrize(("module", "commands"), COMMANDS.items())
def test_a_module_registers_the_commands_of_the_table(
    module: str, commands: tuple[str, ...]
) -> None:
    app = typer.Typer()
    app.callback()(lambda: None)
    import_module(f"fleet.cli.{module}").register(app)
    assert commands_of(app) == [*commands]


@pytest.mark.parametrize("arguments", [[], ["--help"], ["--version"], ["no_such"], ["-h", "run"]])
def test_what_begins_with_no_command_knows_all(arguments: list[str]) -> None:
    assert commands_of(application(arguments)) == [c for cs in COMMANDS.values() for c in cs]


@pytest.mark.parametrize(("module", "commands"), COMMANDS.items())
def test_a_command_comes_with_those_of_its_module_alone(
    module: str, commands: tuple[str, ...]
) -> None:
    for command in commands:
        assert commands_of(application([command, "--help"])) == [*COMMANDS[module]]


def test_a_command_does_not_wait_for_what_another_needs() -> None:
    program = (
        "import sys\n"
        "from fleet.cli import application\n"
        "application(['cat', 'run.mcap'])\n"
        "print(*sorted(m for m in sys.modules if m.startswith('fleet.cli.')))\n"
        "print('fleet.agents.agent' in sys.modules)\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    names, flies = told.stdout.splitlines()
    assert "fleet.cli.cat" in names.split()
    assert not {"fleet.cli.run", "fleet.cli.fuzz", "fleet.cli.report"} & {*names.split()}
    assert flies == "False"
