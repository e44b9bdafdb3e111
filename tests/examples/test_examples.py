"""Each example runs as it stands, in a folder of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))
SAID = {
    "data_frame": "climb_mps",
    "own_fault": "fleet check: valid",
    "own_vehicle": "least separation 1.",
    "own_resolver": "turn right: least separation",
    "run_and_plot": "least normalised separation 1.",
}


def test_every_example_is_tested() -> None:
    assert {path.stem for path in EXAMPLES} == SAID.keys()


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(path: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", path],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert SAID[path.stem] in done.stdout
