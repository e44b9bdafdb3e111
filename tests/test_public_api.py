"""`import fleet`: what it gives, what it costs, and what goes wrong in words."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


def test_a_log_is_as_good_as_its_run(tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    run = fleet.run(fleet.load_scenario("head_on", {"duration_s": 1}), out=out)
    for path in (out, str(out)):
        assert fleet.measure(path) == fleet.measure(run)
        assert fleet.check(path) == fleet.check(run)
        assert fleet.repeat(path).verdict == "same"
        with pytest.raises(fleet.LogError, match="cannot read"):
            fleet.check(f"{path}.none")
    assert repr(fleet.LogReplay(out, topics="1/truth")).startswith(f"<replay of {out}")


def test_settings_are_laid_over_a_scenario_that_is_there() -> None:
    changed = fleet.load_scenario(fleet.load_scenario("head_on"), {"duration_s": 7})
    assert changed == fleet.load_scenario("head_on", {"duration_s": 7})


RUN = "expected a run, or the path of its log, not"
SCENARIO = "scenario: expected a name, a TOML file, a table or a Scenario, not"
DICT = 'expected a dict, as {"resolution.horizon_s": 30}, not'
FAULTS = 'faults: expected a dict of text or lists of text, as {"loss": "30%"}, not'
ONE_TOPIC = "topics: expected a topic or key expression, as 1/truth, not 5"
api: Any = fleet
WRONG: dict[str, tuple[Callable[[Any], object], str]] = {
    "measure": (api.measure, f"measure: {RUN} 5"),
    "check": (api.check, f"check: {RUN} 5"),
    "repeat": (api.repeat, f"repeat: {RUN} 5"),
    "replay": (api.LogReplay, f"LogReplay: {RUN} 5"),
    "replay how fast": (
        lambda x: api.LogReplay("x", rate=str(x)),
        "rate: expected a number, not '5'",
    ),
    "replay what": (
        lambda x: api.LogReplay("x", topics=x),
        "topics, exclude or remap: expected a text or a list of text, not 5",
    ),
    "replay as": (lambda x: api.LogReplay("x", run=x), "run: expected the name of a run, not 5"),
    "open": (api.open_log, "open_log: expected the path of a log, not 5"),
    "log": (api.Log, "Log: expected the path of a log, not 5"),
    "run": (api.run, f"{SCENARIO} 5"),
    "run a list": (lambda x: api.run([x]), f"{SCENARIO} [5]"),
    "run a module": (lambda _: api.run(fleet), f"{SCENARIO} this module"),
    "run of whom": (lambda x: api.run("side", resolver=x), "resolver: expected a class or a n"),
    "run to where": (lambda x: api.run("side", out=x), "out: expected the path of a log, not 5"),
    "run on what": (lambda x: api.run("side", bus=x), "bus=5, clock='lockstep': there are mem"),
    "run how fast": (lambda x: api.run("side", speed=[x]), "speed: expected a number, not [5]"),
    "run and show": (lambda x: api.run("side", progress=x), "progress: expected a function, n"),
    "load": (api.load_scenario, f"{SCENARIO} 5"),
    "load settings": (lambda x: api.load_scenario("side", x), f"settings: {DICT} 5"),
    "load no keys": (lambda x: api.load_scenario("side", {x: 1}), f"settings: {DICT} 5"),
    "load a list": (lambda _: api.load_scenario("side", ["a=1"]), f"settings: {DICT} ['a=1']"),
    "load faults": (lambda x: api.load_scenario("side", faults=x), f"{FAULTS} 5"),
    "load a fault": (lambda x: api.load_scenario("side", faults={"loss": x}), f"{FAULTS} 5"),
    "load several": (lambda x: api.load_scenario("side", faults={"loss": [x]}), f"{FAULTS} 5"),
    "volumes": (lambda x: api.measure("x", [x]), "measure: expected volumes as (fleet.NMAC,), n"),
    "a volume": (lambda _: api.measure("x", fleet.NMAC), "measure: expected volumes as (fleet."),
    "tolerance": (lambda x: api.measure("x", tolerance=x), "measure: expected a fleet.Toleran"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_type_is_told_in_a_line(case: str) -> None:
    call, words = WRONG[case]
    with pytest.raises(fleet.ArgumentError) as raised:
        call(5)
    assert str(raised.value).startswith(words)
    assert isinstance(raised.value, ValueError)


def test_what_is_no_topic_is_told_in_a_line(tmp_path: Path) -> None:
    run = fleet.run(fleet.load_scenario("head_on", {"duration_s": 1}), out=tmp_path / "x.mcap")
    number: Any = 5
    for columns in (run.__getitem__, run.log.columns):
        with pytest.raises(fleet.ArgumentError, match=ONE_TOPIC):
            columns(number)
