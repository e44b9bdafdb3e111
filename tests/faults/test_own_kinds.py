"""A kind of fault from outside of the package is as good as any."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

RECIPE = Path(__file__).parents[2] / "docs" / "extending" / "fault.md"


def fleet(
    folder: Path, *arguments: str, own: str = "own_faults"
) -> subprocess.CompletedProcess[str]:
    """The command in a folder, with kinds of faults from there."""
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "FLEET_FAULT_KINDS": own, "PYTHONPATH": root}
    command = [sys.executable, "-m", "fleet", *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def recipe() -> str:
    """The code of the recipe's example."""
    found = re.search(r"^```python\n(.*?)^```", RECIPE.read_text(), re.DOTALL | re.MULTILINE)
    assert found
    return found[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the recipe's example is a module."""
    path = tmp_path_factory.mktemp("own")
    (path / "own_faults.py").write_text(recipe())
    return path


def test_the_recipe_is_flown_checked_and_measured(folder: Path) -> None:
    flown = fleet(folder, "run", "head_on", "--every-nth", "3@2s", "--duration", "8",
                  "--out", "own.mcap", "--json")  # fmt: skip
    assert flown.returncode == 0, flown.stderr
    assert "fault: every_nth start_s=2" in flown.stderr
    assert json.loads(flown.stdout)["delivery"]["adsb"]["dropped"]["every_nth"] > 10
    checked = fleet(folder, "check", "own.mcap", "--json")
    assert checked.returncode == 2, checked.stdout  # unknown: there was no election yet
    (told,) = json.loads(checked.stdout)["logs"]
    verdicts = {row["name"]: row["verdict"] for row in told["invariants"]}
    assert verdicts["fault plan applied"] == verdicts["nothing lost silently"] == "valid"
    measured = json.loads(fleet(folder, "metrics", "own.mcap", "--json").stdout)
    ratios = [link["expected_ratio"] for link in measured["links"] if link["kind"] == "adsb"]
    assert ratios
    assert all(0.6 < ratio < 0.8 for ratio in ratios)


@pytest.mark.parametrize("how", [["check"], ["format", "--check"]], ids=" ".join)
def test_the_recipe_is_green_as_a_module_of_the_package(how: list[str]) -> None:
    options = ["--quiet", "--stdin-filename", "fleet/faults/kinds/every_nth.py", "-"]
    found = subprocess.run(
        [sys.executable, "-m", "ruff", *how, *options],
        cwd=RECIPE.parents[2],
        input=recipe(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 0, found.stdout


def test_random_cases_have_it_too(folder: Path) -> None:
    program = (
        "from fleet.fuzz.cases import case_of\n"
        "found = [r['kind'] for n in range(60) for r in case_of(n)['fault']]\n"
        "assert 'every_nth' in found, found"
    )
    environment = {**os.environ, "FLEET_FAULT_KINDS": "own_faults"}
    environment["PYTHONPATH"] = str(Path(__file__).parents[2])
    command = [sys.executable, "-c", program]
    subprocess.run(command, cwd=folder, env=environment, check=True)


def test_a_module_that_is_not_there_is_one_line(folder: Path) -> None:
    found = fleet(folder, "--version", own="nowhere")
    assert found.returncode == 2
    assert found.stderr == "fleet: FLEET_FAULT_KINDS: No module named 'nowhere'\n"


@pytest.mark.parametrize(
    ("own", "code", "why"),
    [
        ("./broken", "", "'./broken' is a path; name a module, as my_own or package.own"),
        ("broken.py", "", "'broken.py' is a path; name a module, as my_own or package.own"),
        ("broken", "1 / 0\n", "broken: ZeroDivisionError: division by zero (broken.py, line 1)"),
        ("broken", "x = (\n", "broken: SyntaxError: '(' was never closed (broken.py, line 1)"),
        (
            "broken",
            recipe().replace("def passes(self, _link", "def passing(self, _link"),
            "broken: TypeError: EveryNth: a kind of fault has to say passes (broken.py, line 19)",
        ),
    ],
    ids=("path", "file", "raises", "syntax", "unsaid"),
)
def test_a_module_that_cannot_be_imported_is_one_line(
    tmp_path: Path, own: str, code: str, why: str
) -> None:
    (tmp_path / "broken.py").write_text(code)
    found = fleet(tmp_path, "scenarios", own=own)
    assert found.returncode == 2
    assert found.stderr == f"fleet: FLEET_FAULT_KINDS: {why}\n"


def test_names_of_modules_may_have_spaces_between_them(folder: Path) -> None:
    assert fleet(folder, "scenarios", own=" own_faults, json ").returncode == 0
