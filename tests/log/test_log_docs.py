"""The examples of docs/logs.md run."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.config.loading import read_scenario
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.conftest import Cli

LOGS = (Path(__file__).parents[2] / "docs" / "logs.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```", LOGS, re.DOTALL | re.MULTILINE)
COMMANDS = re.findall(r"^fleet (.*)$", LOGS, re.MULTILINE)


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    loaded = read_scenario("head_on", ["duration_s=45"])
    run_fleet(RunOptions(loaded.scenario, bus="memory", out=path), lambda _: None)
    return path.read_bytes()


def test_there_are_examples() -> None:
    assert len(EXAMPLES) == 5
    assert len(COMMANDS) == 5


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_examples_run(content: bytes, example: str, tmp_path: Path) -> None:
    if ".frame(" in example:
        pytest.importorskip("pandas")
    (tmp_path / "run.mcap").write_bytes(content)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", example],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_run(cli: Cli, content: bytes, command: str) -> None:
    for name in ("run.mcap", "killed.mcap"):
        (cli.folder / name).write_bytes(content)
    done = cli.run(*shlex.split(command.partition(" > ")[0]))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout
