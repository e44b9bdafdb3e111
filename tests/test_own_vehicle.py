"""A vehicle model from outside of the package is as good as any: examples/own_vehicle.py."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_glossary import MODULES, top_level

ROOT = Path(__file__).parent.parent
MODULE = (ROOT / "examples" / "own_vehicle.py").read_text(encoding="utf-8")
RECIPE = (ROOT / "docs" / "extending" / "vehicle.md").read_text(encoding="utf-8")
MEET = """
name = "meet"
duration_s = 50

[resolution]
horizon_s = 20

[[uav]]
id = 1
position_ned_m = [0, -1100, -300]
heading_deg = 90
waypoints_ned_m = [[0, 3000, -300]]

[[uav]]
id = 2
position_ned_m = [0, 1100, -300]
heading_deg = -90
waypoints_ned_m = [[0, -3000, -300]]
performance = { vehicle = "multicopter", max_yaw_rate_degps = 15 }
"""


def python(folder: Path, *arguments: str, own: str = "own_vehicle") -> tuple[int, str, str]:
    """Exit code, output and errors of Python in a folder, with vehicles from there."""
    environment = {**os.environ, "FLEET_VEHICLE_MODELS": own, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the example is a module, and has been flown over zenoh."""
    path = tmp_path_factory.mktemp("own")
    (path / "own_vehicle.py").write_text(MODULE)
    (path / "meet.toml").write_text(MEET)
    flown = python(path, "-m", "fleet", "run", "meet.toml", "--out", "own.mcap", "--json")
    assert flown[0] == 0, flown[2]
    return path


def test_it_is_avoided_checked_measured_and_reported(folder: Path) -> None:
    assert python(folder, "-m", "fleet", "check", "own.mcap")[0] == 0
    code, out, err = python(folder, "-m", "fleet", "metrics", "own.mcap", "--json")
    assert code == 0, err
    measured = json.loads(out)
    assert 1.0 <= measured["totals"]["least_separation"] < 1.5
    assert measured["commands"]["applied"] > 0
    code, _, err = python(folder, "-m", "fleet", "report", "own.mcap", "--out", "own.html")
    assert code == 0, err
    assert "multicopter" in (folder / "own.html").read_text(encoding="utf-8")


def test_it_gives_the_same_digest_on_both_buses(folder: Path) -> None:
    code, out, err = python(folder, "-m", "fleet", "repeat", "own.mcap", "--bus", "memory")
    assert code == 0, out + err
    assert "same: 501 ticks" in out


def test_nothing_is_imported_because_a_log_or_a_scenario_names_it(folder: Path) -> None:
    for command in (("check", "own.mcap"), ("run", "meet.toml")):
        code, _, err = python(folder, "-m", "fleet", *command, own="")
        assert code == 2
        assert "'multicopter'" in err
        assert "FLEET_VEHICLE_MODELS" in err
        assert len(err.splitlines()) == 1


def test_its_own_check_of_values_is_told(folder: Path) -> None:
    fast = "uav.2.performance.max_yaw_rate_degps=60"
    code, _, err = python(folder, "-m", "fleet", "run", "meet.toml", "--set", fast)
    assert code == 2
    assert "uav.2: performance.max_yaw_rate_degps: turns at 25 m/s would need more than 1 g" in err


def test_a_key_of_the_other_model_is_told_whose_it_is(folder: Path) -> None:
    settings = ("performance.max_yaw_rate_degps=60", "uav.2.performance.max_bank_deg=20")
    told = (
        "performance.max_yaw_rate_degps: unknown key of vehicle 'point_mass', but one of "
        "'multicopter'; possible here: vehicle, max_bank_deg,",
        "uav.2.performance.max_bank_deg: unknown key of vehicle 'multicopter', but one of "
        "'point_mass'; possible here: vehicle, max_yaw_rate_degps,",
    )
    for setting, words in zip(settings, told, strict=True):
        code, _, err = python(folder, "-m", "fleet", "run", "meet.toml", "--set", setting)
        assert code == 2
        assert words in err


def test_what_holds_of_every_model_holds_of_it(folder: Path) -> None:
    tests = str(ROOT / "tests" / "model" / "test_vehicle_models.py")
    options = ("-k", "multicopter", "-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml"))
    code, out, _ = python(folder, "-m", "pytest", tests, "--rootdir", str(ROOT), *options)
    assert code == 0, out


def test_a_program_flies_it_on_either_bus(folder: Path) -> None:
    program = (
        "import own_vehicle, fleet\n"
        "scenario = fleet.load_scenario('meet.toml', {'duration_s': 3})\n"
        "print(len({fleet.run(scenario, bus=bus).digest for bus in ('memory', 'zenoh')}))"
    )
    (folder / "program.py").write_text(program)
    assert python(folder, "program.py", own="")[:2] == (0, "1\n")


def test_a_module_that_is_not_there_is_one_line(folder: Path) -> None:
    code, _, err = python(folder, "-m", "fleet", "check", "own.mcap", own="nowhere")
    assert (code, err) == (2, "fleet: FLEET_VEHICLE_MODELS: No module named 'nowhere'\n")


def test_as_a_module_of_the_package_it_defines_no_name_a_second_time() -> None:
    there = {name for path in MODULES for name in top_level(path)}
    assert there & {*top_level(ROOT / "examples" / "own_vehicle.py")} == set()


def test_the_recipe_shows_the_example() -> None:
    shown = re.findall(r"^```python\n(.*?)^```", RECIPE, re.DOTALL | re.MULTILINE)
    assert shown
    assert all(part.strip() in MODULE for part in shown)
