"""The layering that docs/ARCHITECTURE.md describes, held against the code."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MODULES = sorted(
    p for part in ("fleet", "agents", "coordinator") for p in (ROOT / part).rglob("*.py")
)

ALLOWED = {
    "fleet.model": {"fleet.model"},
    "fleet.comms": {"fleet.model", "fleet.comms"},
    "fleet.log": {"fleet.comms", "fleet.log", "fleet.model", "fleet.config.loading", "fleet"},
    "fleet.analysis": {"fleet.model", "fleet.comms", "fleet.log", "fleet.analysis"},
    "fleet.export": {"fleet.model", "fleet.comms", "fleet.log", "fleet.analysis", "fleet.export"},
    "fleet.report": {"fleet.model", "fleet.comms", "fleet.log", "fleet.analysis", "fleet.report"},
    "fleet.replay": {"fleet.model", "fleet.comms", "fleet.log", "fleet.analysis", "fleet.replay"},
    "fleet.config.loading": {"fleet.model", "fleet.config.loading"},
    "agents": {"agents", "fleet.model", "fleet.comms"},
    "coordinator": {"coordinator", "fleet.model", "fleet.comms"},
}
"""What each package may import of ours; fleet.simulation and fleet.cli may import all."""


def name_of(path: Path) -> str:
    """Dotted name of a module."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def package_of(name: str) -> str:
    """The layer of a module: `fleet.x`, `agents` or `coordinator`."""
    parts = name.split(".")
    return ".".join(parts[:2]) if parts[0] == "fleet" else parts[0]


def imports(path: Path) -> Iterator[str]:
    """Modules that a file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def test_there_is_something_to_check() -> None:
    assert len(MODULES) > 30


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_point_one_way(path: Path) -> None:
    allowed = ALLOWED.get(package_of(name_of(path)))
    if allowed is None:
        return
    ours = {
        package_of(i)
        for i in imports(path)
        if i.split(".")[0] in ("fleet", "agents", "coordinator")
    }
    assert ours <= allowed


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_effects_stay_at_the_edge(path: Path) -> None:
    name, roots = name_of(path), {i.split(".")[0] for i in imports(path)}
    if "zenoh" in roots:
        assert name == "fleet.transport.zenoh_bus"
    if "mcap" in roots:
        assert name.startswith("fleet.log")
    if "matplotlib" in roots:
        assert name.startswith("fleet.report.paper")
    if "plotly" in roots:
        assert name == "fleet.report.page"
    if "time" in roots:
        assert name.startswith(("fleet.simulation", "fleet.cli", "fleet.log", "fleet.fuzz")) or (
            name in ("fleet.transport.zenoh_bus", "fleet.node.delay_line")
            or name in ("fleet.replay.player_input", "fleet.replay.flush")
        )
    if "random" in roots:
        assert name in ("fleet.config.traffic", "fleet.fuzz.cases")
    assert not roots & {"datetime", "logging"}


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_files_stay_small(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400
