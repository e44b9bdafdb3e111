"""`import fleet`: what it gives, what it costs, and what goes wrong in words."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

import fleet
from fleet.agents.resolvers import NoResolver
from tests.support import samples


def python(program: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A script, run as a user would."""
    (folder / "script.py").write_text(program, encoding="utf-8")
    return subprocess.run(
        [sys.executable, "script.py"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_every_public_name_is_there_and_where_type_checkers_look() -> None:
    assert set(fleet.__all__) == {*fleet._WHERE, "__version__"}
    for name, module in fleet._WHERE.items():
        assert getattr(fleet, name) is getattr(importlib.import_module(module), name)
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        fleet.fly  # type: ignore[attr-defined]  # noqa: B018


def test_to_import_it_loads_nothing_else(tmp_path: Path) -> None:
    program = "import sys, fleet\nprint('numpy' in sys.modules, 'msgspec' in sys.modules)"
    assert python(program, tmp_path).stdout == "False False\n"


def test_both_buses_give_the_same_run_and_its_log_goes_with_it() -> None:
    scenario = msgspec.structs.replace(samples.head_on(), duration_s=3.0)
    memory, zenoh = fleet.run(scenario), fleet.run(scenario, bus="zenoh")
    assert memory.digest == zenoh.digest
    assert len(memory["1/truth"].position_ned_m) == 31
    assert fleet.measure(memory).end_s == 3.0
    assert fleet.check(memory).broken == ()
    assert fleet.repeat(memory).verdict == "same"
    path = memory.path
    assert path is not None
    assert path.exists()
    del memory
    assert not path.exists()


def test_a_log_that_is_named_is_kept_and_not_overwritten(tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    flown = fleet.run(fleet.load_scenario("head_on", {"duration_s": 1}), out=out)
    again = fleet.open_log(out)
    assert (again.digest, again.ticks) == (flown.digest, 11)
    with pytest.raises(fleet.LogError, match="exists already"):
        fleet.run(flown.scenario, out=out)


def test_settings_and_faults_are_laid_over_a_scenario() -> None:
    settings = {"resolution.horizon_s": 20, "uav.2.speed_mps": 30.0}
    scenario = fleet.load_scenario("head_on", settings, {"loss": "30%", "kill": ["1@3s", "2@4s"]})
    assert scenario.resolution.horizon_s == 20.0
    assert scenario.uav[1].speed_mps == 30.0
    assert [rule.name for rule in scenario.fault] == ["loss", "kill", "kill"]
    table = {"name": "mine", "duration_s": 5, "generate": {"kind": "converge", "count": 2}}
    assert fleet.load_scenario(table).name == "mine"


@pytest.mark.parametrize(
    ("settings", "faults", "why"),
    [
        ({"sed": 1}, {}, "sed: unknown key .did you mean 'seed'"),
        ({"uav.7.speed_mps": 1}, {}, "setting 'uav.7.speed_mps': there is no UAV with ID '7'"),
        ({}, {"lost": "3%"}, "faults: no 'lost'; there are"),
        (
            {"fault": [{"kind": "loss", "probability": 1}]},
            {"kill": "9@1s"},
            "^faults: kill 9@1s .node",
        ),
        ({}, {"loss": "300%"}, "faults: loss: '300%' is"),
    ],
)
def test_what_cannot_be_a_scenario_is_said(
    settings: dict[str, object], faults: dict[str, str], why: str
) -> None:
    with pytest.raises(fleet.ScenarioError, match=why):
        fleet.load_scenario("head_on", settings, faults)


def test_a_scenario_built_in_code_is_checked_before_it_is_flown() -> None:
    with pytest.raises(fleet.ScenarioError, match="duration_s"):
        fleet.run(fleet.Scenario("odd", -1.0, generate=None))


def test_what_does_nothing_is_warned_of() -> None:
    scenario = fleet.load_scenario("head_on", {"duration_s": 1}, {"kill": "1@50s"})
    with pytest.warns(fleet.RunWarning, match="kill"):
        fleet.run(scenario)


def test_a_resolver_can_be_a_class() -> None:
    scenario = fleet.load_scenario("head_on", {"duration_s": 1})
    assert fleet.run(scenario, resolver=NoResolver).scenario.resolver.endswith(":NoResolver")

    class Hidden(NoResolver):
        pass

    with pytest.raises(fleet.ScenarioError, match="a class at the top of a module"):
        fleet.run(scenario, resolver=Hidden)


def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    done = python(
        "import fleet\nprint('begun')\n"
        "scenario = fleet.load_scenario('head_on', {'duration_s': 1})\n"
        "print(fleet.run(scenario, bus='zenoh').ticks)",
        tmp_path,
    )
    assert (done.returncode, done.stdout) == (0, "begun\n11\n"), done.stderr


OWN = """
import fleet
class Own:
    def __init__(self, scenario): pass
    def resolve(self, situation): return ()
scenario = fleet.load_scenario("head_on", {"duration_s": 1})
"""


@pytest.mark.parametrize(
    ("call", "why"),
    [
        ("fleet.run(scenario, resolver=Own, bus='zenoh')", "put it into a module of its own"),
        ("fleet.run(fleet.load_scenario('head_on', {'resolver': 'script:Own'}))", "__main__"),
    ],
)
def test_a_script_that_would_fly_again_in_every_process_is_told_so(
    call: str, why: str, tmp_path: Path
) -> None:
    done = python(OWN + call, tmp_path)
    assert done.returncode == 1
    assert "ScenarioError" in done.stderr.splitlines()[-1]
    assert why in done.stderr.splitlines()[-1]


def test_a_kind_of_fault_in_the_script_flies_in_memory_and_is_refused_over_zenoh(
    tmp_path: Path,
) -> None:
    example = Path(__file__).parents[1] / "examples" / "own_fault.py"
    program = example.read_text(encoding="utf-8").partition("rule = ")[0] + (
        "table = {'duration_s': 1, 'fault': [{'kind': 'every_third'}]}\n"
        "scenario = fleet.load_scenario('head_on', table)\n"
        "print(fleet.run(scenario).ticks)\n"
        "fleet.run(scenario, bus='zenoh')"
    )
    done = python(program, tmp_path)
    assert (done.returncode, done.stdout) == (1, "11\n")
    last = done.stderr.splitlines()[-1]
    assert "ScenarioError: EveryThird is in the script that is run" in last


def test_results_show_what_they_say_and_a_resolver_may_be_named(tmp_path: Path) -> None:
    scenario = fleet.load_scenario("head_on", {"duration_s": 1})
    out = tmp_path / "run.mcap"
    run = fleet.run(scenario, resolver="none", out=out)
    assert run.scenario.resolver == "none"
    assert repr(fleet.repeat(run)) == "<same, 11 ticks compared>"
    assert re.fullmatch(r"<unknown: .+>", repr(fleet.check(run)))
    words = "2 UAVs, 1 s, least separation 9.875, 0 pairs lost separation"
    assert repr(fleet.measure(run)) == f"<metrics of head_on: {words}>"
    with pytest.raises(fleet.LogError, match="pass overwrite=True, or another out"):
        fleet.run(scenario, out=out)
    with pytest.raises(fleet.ScenarioError, match="nonesuch"):
        fleet.run(scenario, resolver="nonesuch")


def test_choices_that_exclude_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="as fast as it can"):
        fleet.run("head_on", speed=1.0)
