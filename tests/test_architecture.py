"""The layering that docs/ARCHITECTURE.md describes, held against the code."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PLACES = {"fleet": ROOT / "fleet", "fleet.agents": ROOT / "agents"}
PLACES["fleet.coordinator"] = ROOT / "coordinator"


def _modules() -> Iterator[tuple[str, Path]]:
    """Every module by the name under which it is imported."""
    for package, folder in PLACES.items():
        for path in folder.rglob("*.py"):
            within = path.relative_to(folder).with_suffix("").parts
            if package != "fleet" or within[0] not in ("agents", "coordinator"):
                yield ".".join((package, *within)).removesuffix(".__init__"), path


MODULES = dict(sorted(_modules()))

BASE = {"fleet.errors", "fleet.extras", "fleet.printing", "fleet.version"}
BASE |= {"fleet.arguments", "fleet.html_tables", "fleet.own_modules"}
WIRE = {"fleet.model", "fleet.protocol", "fleet.faults", "fleet.config"}
READERS = WIRE | {"fleet.log", "fleet.analysis"}
ALLOWED = {
    "fleet.model": set(),
    "fleet.protocol": {"fleet.model"},
    "fleet.faults": {"fleet.model", "fleet.protocol"},
    "fleet.config": {"fleet.model", "fleet.protocol", "fleet.faults"},
    "fleet.imports": {"fleet.model", "fleet.config"},
    "fleet.hosts": {"fleet.model", "fleet.config", "fleet.protocol", "fleet.security"},
    "fleet.security": {"fleet.model", "fleet.protocol"},
    "fleet.transport": WIRE | {"fleet.security"},
    "fleet.node": WIRE | {"fleet.transport", "fleet.security"},
    "fleet.agents": WIRE | {"fleet.node"},
    "fleet.coordinator": WIRE | {"fleet.node"},
    "fleet.relay": WIRE | {"fleet.node", "fleet.transport"},
    "fleet.log": WIRE,
    "fleet.analysis": WIRE | {"fleet.log", "fleet.node"},
    "fleet.export": READERS,
    "fleet.report": READERS,
    "fleet.playback": READERS | {"fleet.transport"},
    "fleet.repetition": READERS,
    "fleet.simulation": READERS
    | {"fleet.transport", "fleet.node", "fleet.security"}
    | {"fleet.agents", "fleet.coordinator", "fleet.repetition"},
    "fleet.conformance": WIRE | {"fleet.transport", "fleet.node", "fleet.agents"},
    "fleet.fuzz": READERS | {"fleet.simulation"},
    "fleet.live": READERS | {"fleet.transport", "fleet.simulation", "fleet.export"},
    "fleet.study": READERS | {"fleet.simulation", "fleet.agents"},
    "fleet.study_report": READERS | {"fleet.study", "fleet.report"},
}
"""What each package may import of ours, beside itself and `BASE`."""
TOP = {"fleet", "fleet.cli", "fleet.entry", "fleet.__main__"}
"""What may import everything."""


def package_of(name: str) -> str:
    """The package of a module, as in `fleet.model`."""
    return ".".join(name.split(".")[:2])


def imports(name: str) -> Iterator[str]:
    """Modules that a module imports, ours or not."""
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else node.module


def ours(name: str) -> set[str]:
    """Modules of ours that a module imports."""
    return {i for i in imports(name) if i in MODULES and i != name}


def test_every_package_has_its_place() -> None:
    packages = {package_of(name) for name in MODULES}
    assert packages - BASE - TOP == ALLOWED.keys()


@pytest.mark.parametrize("name", MODULES)
def test_imports_point_one_way(name: str) -> None:
    package = package_of(name)
    if package not in TOP and package not in BASE:
        assert {package_of(i) for i in ours(name)} <= ALLOWED[package] | BASE | {package}


def test_candidates_are_built_by_the_resolver_alone() -> None:
    """What a decision was made of is in the log: no reader builds it again."""
    sets, resolver = "fleet.model.conflict.command_set", "fleet.agents.geometric"
    of_scenario = {"fleet.config.scenario"}  # the altitudes, which bound all manoeuvres
    users = {name for name in MODULES if sets in ours(name)}
    assert users - of_scenario == {"fleet.agents.candidates"}
    assert {name for name in MODULES if resolver in ours(name)} == {"fleet.agents.resolvers"}


def test_statistics_know_nothing_of_runs() -> None:
    """Arrays in, results out: what is studied has no say in what may be concluded."""
    names = [name for name in MODULES if name.startswith("fleet.study.statistics")]
    others = set().union(*(ours(name) for name in names)) - {*names}
    assert others == {"fleet.errors", "fleet.extras", "fleet.model.types"}


def test_nothing_imports_in_a_circle() -> None:
    try:
        TopologicalSorter({name: ours(name) for name in MODULES}).prepare()
    except CycleError as error:
        pytest.fail(" <- ".join(error.args[1]))


@pytest.mark.parametrize("name", MODULES)
def test_effects_stay_at_the_edge(name: str) -> None:
    roots = {i.split(".")[0] for i in imports(name)}
    if "zenoh" in roots:
        assert name.startswith("fleet.transport.")
    if "mcap" in roots:
        assert name.startswith("fleet.log")
    if "matplotlib" in roots:
        assert name.startswith(("fleet.report.paper", "fleet.study_report.paper"))
    assert "pyproj" not in roots  # an extra, loaded where it is needed
    if "plotly" in roots:
        assert name == "fleet.report.page_parts"
    if "time" in roots:
        assert name.startswith(("fleet.simulation", "fleet.cli", "fleet.log", "fleet.fuzz")) or (
            name in ("fleet.transport.zenoh_bus", "fleet.transport.run_search")
            or name == "fleet.node.delay_line"
            or name in ("fleet.playback.player_input", "fleet.playback.flush")
            or name in ("fleet.live.log_source", "fleet.live.foxglove_server")
        )
    if "random" in roots:
        assert name in ("fleet.config.traffic", "fleet.fuzz.cases") or (
            name.startswith(("fleet.study.encounters", "fleet.study.stress_space"))
        )
    if roots & {"cryptography", "datetime"}:  # an extra too; its certificates have dates
        assert name in ("fleet.security.certificates", "fleet.security.checking")
    assert "logging" not in roots
