"""What is installed: one package, `fleet`, so that nobody else's `agents` is in the way."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.conftest import Cli

ROOT = Path(__file__).parent.parent
AT_THE_TOP = {
    *("agents", "benchmarks", "coordinator", "docs", "examples", "fleet", "studies", "tests"),
    *("tools", "pyproject.toml", "constraints.txt", "compose.yaml", "Containerfile"),
    *("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "LICENSE"),
}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The files in a wheel made of this checkout."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("out")
    for name in ("fleet", "agents", "coordinator"):
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=ignore)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    how = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--wheel-dir", str(out)]
    made = [sys.executable, "-m", "pip", "wheel", *how, str(source)]
    subprocess.run(made, check=True, capture_output=True, timeout=100)
    return zipfile.ZipFile(next(out.iterdir())).namelist()


def test_nothing_that_a_program_left_behind_is_committed() -> None:
    listed = ["git", "-C", str(ROOT), "ls-tree", "-z", "--name-only", "HEAD"]
    done = subprocess.run(listed, capture_output=True, text=True, timeout=20, check=False)
    if done.returncode:
        pytest.skip("this is no checkout")
    assert {n for n in done.stdout.split("\0") if n and not n.startswith(".")} == AT_THE_TOP


def test_a_wheel_has_one_package_at_the_top(wheel: list[str]) -> None:
    tops = {name.split("/")[0] for name in wheel}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"fleet"}


def test_a_wheel_has_all_that_is_needed(wheel: list[str]) -> None:
    code = [p for p in (ROOT / "fleet").rglob("*.py") if p.resolve().is_relative_to(ROOT / "fleet")]
    wanted = {str(path.relative_to(ROOT)) for path in code}
    for name in ("agents", "coordinator"):
        wanted |= {f"fleet/{p.relative_to(ROOT)}" for p in (ROOT / name).rglob("*.py")}
    wanted |= {"fleet/py.typed", "fleet/report/page.css", "fleet/report/page.js"}
    wanted |= {"fleet/study_report/study.js"}
    wanted |= {f"fleet/config/scenarios/{name}.toml" for name in ("four_way", "converge")}
    assert wanted - set(wheel) == set()


def test_a_package_of_the_same_name_as_one_of_our_folders_is_not_ours(
    cli: Cli, tmp_path: Path
) -> None:
    for name in ("agents", "coordinator"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("MINE = True\n")
    done = cli.run("run", "side", "--duration", "1", "--bus", "memory", PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stderr
    look = "import agents, coordinator, fleet.agents.agent; print(agents.MINE, coordinator.MINE)"
    seen = cli.command(sys.executable, "-c", look, PYTHONPATH=f"{tmp_path}:{ROOT}")
    assert seen.communicate(timeout=60)[0] == "True True\n"
