"""`fleet import`: what it prints, writes and refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import fleet
from fleet.cli import application

SCN = (
    "00:00:00.00>WIND 0,0,,180,25\n"
    "00:00:00.00>CRE AC1,A320,0,-0.3,90,FL100,250\n"
    "00:00:00.00>CRE AC2,A320,0,0.3,270,FL100,250\n"
    "00:00:00.00>CRE AC3,A320,0.1,0.3,270,FL100,0\n"
)


def called(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(application(arguments), arguments, standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return result.return_value, result.stdout


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wind.scn").write_text(SCN, encoding="utf-8")
    return tmp_path


def test_remarks_are_printed_line_by_line_and_then_what_was_made(here: Path) -> None:
    code, told = called("import", "wind.scn")
    assert code == 0
    assert told.splitlines() == [
        "wind.scn: line 1: WIND 0: there is no wind here: aircraft fly over ground as they do "
        "through the air",
        "wind.scn: line 4: AC3: stationary, at 0 m/s, and a UAV flies more than 1 m/s; left out",
        "wind.toml: 2 UAVs, 580 s, origin 0.0333,0.1,0, zone 4630,152.4; fly it with 'fleet run "
        "wind.toml'",
    ]
    text = (here / "wind.toml").read_text(encoding="utf-8")
    assert "# UAV 2 is AC2\n" in text
    assert "# wind.scn: line 1: WIND 0: there is no wind" in text
    assert fleet.load_scenario("wind.toml") == fleet.import_traffic("wind.scn").scenario


def test_options_say_where_how_large_and_whom(here: Path) -> None:
    options = ["--origin", "0.5,-0.25,100", "--zone", "1000,50", "--only", "AC2", "--only", "AC1"]
    code, told = called("import", "wind.scn", "-o", "x.toml", "--duration", "60", *options)
    assert code == 0
    assert "x.toml: 2 UAVs, 60 s, origin 0.5,-0.25,100, zone 1000,50; fly" in told
    first, second = fleet.load_scenario(here / "x.toml").uav
    assert first.position_ned_m[1] > second.position_ned_m[1]  # AC2 was named first
    assert first.position_ned_m[2] == pytest.approx(-10_000 * 0.3048 + 100.0)


def test_nothing_is_overwritten_unless_it_is_told(here: Path) -> None:
    (here / "wind.toml").write_text("mine", encoding="utf-8")
    with pytest.raises(fleet.LogError, match=r"wind.toml exists already, not overwriting"):
        called("import", "wind.scn")
    assert (here / "wind.toml").read_text(encoding="utf-8") == "mine"
    assert called("import", "wind.scn", "--force")[0] == 0
    with pytest.raises(fleet.LogError, match="is what is read"):
        called("import", "wind.scn", "--out", "wind.scn", "--force")


@pytest.mark.parametrize("option", [["--zone", "5"], ["--origin", "a,b,c"], ["--tolerance", ""]])
def test_what_is_no_list_of_numbers_is_refused(option: list[str], here: Path) -> None:
    with pytest.raises(typer.BadParameter, match="numbers with commas"):
        called("import", "wind.scn", *option)
    assert not (here / "wind.toml").exists()


def test_a_file_of_nobody_leaves_nothing_behind(here: Path) -> None:
    (here / "none.scn").write_text("00:00:00.00>PAN 0,0\n", encoding="utf-8")
    with pytest.raises(fleet.ScenarioError, match=r"none.scn: no aircraft can be taken over"):
        called("import", "none.scn")
    assert sorted(p.name for p in here.iterdir()) == ["none.scn", "wind.scn"]


def test_an_imported_encounter_is_flown_and_separation_is_kept(here: Path) -> None:
    """Two head-on over 2.2 km, at 20 m/s each: nearest after 55 s, at 0 without avoidance."""
    east_m = 76_056.0  # a degree of longitude at 47 degrees north
    rows = [
        f"{name},{t},47.0,{8.0 + (start + speed * t) / east_m:.9f},100\n"
        for t in range(0, 111, 10)
        for name, start, speed in (("A", 0.0, 20.0), ("B", 2200.0, -20.0))
    ]
    (here / "two.csv").write_text(f"id,time_s,lat_deg,lon_deg,alt_m\n{''.join(rows)}")
    made = fleet.import_traffic("two.csv")
    assert repr(made) == "<import of two.csv: 2 UAVs, 0 remarks>"
    plain = fleet.measure(fleet.run(made.scenario, resolver="none"))
    assert plain.totals.least_separation == pytest.approx(0.0, abs=0.001)
    assert plain.pairs[0].t_s == pytest.approx(55.0, abs=0.1)
    kept = fleet.run(made.scenario)
    assert (fleet.measure(kept).totals.least_separation or 0.0) > 1.0
    assert fleet.check(kept).broken == ()
