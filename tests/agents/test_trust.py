"""Code that a log or a simulation names is imported only if the user says so."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from fleet.agents.resolvers import code_behind
from fleet.cli import main
from fleet.config.scenario import Scenario
from fleet.node.join_info import JoinInfo, plan_bytes
from tests.support.mutants import meeting
from tests.support.rewriting import naming_code

EVIL = """
from pathlib import Path
Path(__file__).with_name("imported").touch()
from fleet.agents.resolvers import NoResolver
class Boom(NoResolver):
    pass
"""

Fleet = Callable[..., tuple[int, str, str]]


@pytest.fixture
def fleet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Iterator[Fleet]:
    """Run a command here: exit code, standard output and error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "evil_resolver", raising=False)
    (tmp_path / "evil_resolver.py").write_text(EVIL)

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert isinstance(ended.value.code, int)
        return ended.value.code, *capsys.readouterr()

    yield run
    sys.modules.pop("evil_resolver", None)


def evil() -> Scenario:
    return msgspec.structs.replace(meeting(duration_s=1.0), resolver="evil_resolver:Boom")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log whose metadata name a module in the current folder."""
    return naming_code(tmp_path, evil())


@pytest.mark.parametrize("more", [(), ("--loss", "10%"), ("--set", "seed=3")])
def test_a_log_imports_nothing(fleet: Fleet, log: Path, tmp_path: Path, more: tuple[str]) -> None:
    code, out, err = fleet("repeat", log, *more)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"module 'evil_resolver', from {tmp_path / 'evil_resolver.py'}" in err
    assert "give --trust to run it, or another with --set resolver=geometric" in err
    assert not (tmp_path / "imported").exists()


@pytest.mark.parametrize("more", [("--trust",), ("--set", "resolver=evil_resolver:Boom")])
def test_who_says_so_may_run_it(fleet: Fleet, log: Path, tmp_path: Path, more: tuple[str]) -> None:
    code, _, err = fleet("repeat", log, *more)
    assert (code, err) == (0, "")
    assert (tmp_path / "imported").exists()


def test_built_in_resolvers_need_no_word(fleet: Fleet, log: Path, tmp_path: Path) -> None:
    assert fleet("repeat", tmp_path / "honest.mcap")[0] == 0
    assert fleet("repeat", log, "--set", "resolver=geometric")[0] == 0
    assert not (tmp_path / "imported").exists()


@pytest.mark.parametrize(
    "command",
    [["check"], ["metrics"], ["compare"], ["info"], ["report"], ["export", "--csv"], ["cat"]],
    ids=" ".join,
)
def test_other_readers_import_nothing_either(
    fleet: Fleet, log: Path, tmp_path: Path, command: list[str]
) -> None:
    logs = [log, tmp_path / "honest.mcap"] if command == ["compare"] else [log]
    fleet(*command, *logs)
    assert not (tmp_path / "imported").exists()


def test_a_simulation_imports_nothing_into_a_uav(
    fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[JoinInfo] = []
    answer = ("rogue", plan_bytes("lockstep", evil()))
    monkeypatch.setattr("fleet.cli.roles.find_plan", lambda *_: answer)
    monkeypatch.setattr("fleet.cli.roles.uav_main", lambda join_info, _: flown.append(join_info))
    code, out, err = fleet("uav", 1)
    assert (code, out, err.count("\n"), flown) == (2, "", 1, [])
    assert "run rogue names a resolver that would be imported, 'evil_resolver:Boom'" in err
    assert not (tmp_path / "imported").exists()
    assert fleet("uav", 1, "--trust")[0] == 0
    assert [m.scenario.resolver for m in flown] == ["evil_resolver:Boom"]


def test_a_simulation_that_tells_of_an_impossible_scenario_is_refused(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = meeting(duration_s=1.0)
    twice = msgspec.structs.replace(one, uav=(*one.uav, one.uav[0]))
    answer = ("rogue", plan_bytes("lockstep", twice))
    monkeypatch.setattr("fleet.cli.roles.find_plan", lambda *_: answer)
    for role in (["uav", "1"], ["coordinator"]):
        code, _, err = fleet(*role)
        assert (code, err.count("\n")) == (2, 1)
        assert "ID 1 is used more than once" in err


def test_where_code_is_is_found_without_importing_its_package(tmp_path: Path) -> None:
    (tmp_path / "evil_package").mkdir()
    (tmp_path / "evil_package" / "__init__.py").write_text(EVIL)
    (tmp_path / "evil_package" / "inner.py").write_text(EVIL)
    asked = (
        "from fleet.agents.resolvers import code_behind; print(code_behind('evil_package.inner:X'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", asked], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    where = tmp_path / "evil_package" / "__init__.py"
    assert done.stdout.strip() == f"module 'evil_package.inner', from {where}"
    assert not list(tmp_path.rglob("imported"))


@pytest.mark.parametrize("name", ["nowhere_at_all:X", "a\0b:X", ":", "", "..x:Y"])
def test_code_that_is_nowhere_is_told_too(name: str) -> None:
    assert code_behind(name) == f"module '{name.partition(':')[0]}'"
