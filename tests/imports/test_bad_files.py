"""Files that are none, or wrong: one line that says what, where and what to do."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.loading import load_scenario
from fleet.errors import ArgumentError, MissingExtraError, ScenarioError
from fleet.imports.importing import import_traffic

HEADER = "id,time_s,lat_deg,lon_deg,alt_m\n"
ROW = "A,0,47,8,100\n"
UNITS = "NAME lat lon alt time\n[none] [deg] [deg] [ft] [s]\n"
CASES: dict[str, tuple[str, bytes | str, str]] = {
    "empty": (".csv", "", r"test.csv: empty$"),
    "blank": (".daa", "\n \n", r"test.daa: empty$"),
    "encoding": (".csv", HEADER.encode("utf-16"), r"test.csv: text in UTF-16; save it as UTF-8$"),
    "latin": (".scn", b"00:00:00.00>ECHO \xe9\n", r"test.scn: not a text file in UTF-8$"),
    "binary": (".csv", b"a\0b", r"null characters$"),
    "suffix": (".txt", ROW, r"its name ends in none of .scn, .daa, .xyz, .csv; rename it$"),
    "no header": (".csv", ROW, r"line 1: no column id; the columns are id,time_s,lat_deg"),
    "no unit": (".csv", "id,time,lat,lon,alt\n", r"line 1: no column alt_m \('alt' has no unit"),
    "twice": (".csv", "id,time,lat,lat_deg,lon,alt_m\n", r"line 1: two columns for lat_deg; keep"),
    "no rows": (".csv", HEADER, r"test.csv: no row of states under its line of columns$"),
    "nan": (".csv", f"{HEADER}A,0,nan,8,100\n", r"line 2: lat: 'nan' is no finite number; give"),
    "infinite": (".csv", f"{HEADER}A,inf,47,8,100\n", r"line 2: time: 'inf' is no finite number"),
    "a word": (".csv", f"{HEADER}A,0,47,8,high\n", r"line 2: alt: 'high' is no number; give a"),
    "nothing": (".csv", f"{HEADER}A,0,47,,100\n", r"line 2: lon: no value; give a number$"),
    "no name": (".csv", f"{HEADER},0,47,8,100\n", r"line 2: id: no value; name the aircraft$"),
    "range": (".csv", f"{HEADER}A,0,97,8,100\n", r"line 2: lat: 97 is out of range; look at its"),
    "short": (".csv", f"{HEADER}A,0,47\n", r"line 2: 3 values for 5 columns; give all$"),
    "quote": (".csv", f'{HEADER}"A,0,47,8,1\n', r"line 3: 1 values for 5 columns"),
    "duplicate": (
        ".csv",
        f"{HEADER}{ROW}A,0,48,8,1\n",
        r"line 3: a second row of 'A' at 0 s",
    ),
    "one row": (".csv", f"{HEADER}{ROW}", r"line 2: 'A' has one row and no velocity; give a seco"),
    "standing": (".csv", f"{HEADER}{ROW}A,9,47,8,100\n", r"no aircraft .*: line 2: A: stationary"),
    "no columns": (".daa", "# nothing\n", r"test.daa: no line of column names; is it a file of D"),
    "no time": (".daa", "some words\n", r"line 1: no column name; it names them before all rows$"),
    "no position": (".daa", "NAME lat lon\n", r"line 1: no column alt or sz; it names them"),
    "strange unit": (
        ".daa",
        UNITS.replace("ft", "furlong"),
        r"line 2: alt: '\[furlong\]' is",
    ),
    "missing unit": (
        ".daa",
        UNITS.replace("[ft]", "[none]"),
        r"line 2: alt: no unit; there are",
    ),
    "few units": (".daa", UNITS.replace("[s]", ""), r"line 2: 4 units for 5 columns; give each on"),
    "few values": (".daa", f"{UNITS}A 47 8\n", r"line 3: 3 values for 5 columns; give all$"),
    "daa nan": (".daa", f"{UNITS}A 47 8 nan 0\n", r"line 3: alt: 'nan' is no finite number"),
    "daa twice": (".daa", f"{UNITS}A 1 8 9 0\nA 2 8 9 0\n", r"line 4: a second row of 'A' at 0 s"),
    "no command": (".scn", "hello there\n", r"no aircraft can be taken over: line 1: hello there"),
    "nobody": (".scn", "00:00:00.00>PAN 0,0\n", r"no aircraft can be taken over: PAN \(1\): show"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bad_file_is_told_in_a_line(case: str, tmp_path: Path) -> None:
    suffix, content, why = CASES[case]
    file = tmp_path / f"test{suffix}"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ScenarioError, match=why) as raised:
        import_traffic(file)
    assert "\n" not in str(raised.value)


def test_what_is_no_file_is_told_too(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot be read: No such file"):
        import_traffic(tmp_path / "nope.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(ScenarioError, match=r"folder.csv"):
        import_traffic(tmp_path / "folder.csv")


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"origin": 5}, r"origin: expected latitude, longitude and altitude, as \(47.4, 8.5"),
        ({"origin": (1.0, 2.0)}, "origin: expected latitude"),
        ({"origin": (95.0, 2.0, 0.0)}, r"^origin: latitude_deg: expected a number <= 90.0$"),
        ({"zone": (0.0, 5.0)}, r"^zone: radius_m: expected a number >= 0.001$"),
        ({"tolerance_m": (-1.0, 5.0)}, r"^tolerance_m: across_m: expected a number >= 0.001$"),
        ({"tolerance_m": (1.0, "x")}, r"^tolerance_m: up_m: expected a number, got text$"),
        ({"only": "A"}, "only: expected names of aircraft"),
    ],
)
def test_wrong_arguments_are_told(more: dict[str, Any], why: str, tmp_path: Path) -> None:
    file = tmp_path / "test.csv"
    file.write_text(f"{HEADER}{ROW}A,9,47,8.01,100\n", encoding="utf-8")
    with pytest.raises(ArgumentError, match=why):
        import_traffic(file, **more)


def test_a_name_that_is_not_there_is_told(tmp_path: Path) -> None:
    file = tmp_path / "test.csv"
    file.write_text(f"{HEADER}{ROW}A,9,47,8.01,100\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"test.csv: no aircraft 'B'; there are A"):
        import_traffic(file, only=["B"])


def test_names_of_others_move_no_cursor_and_break_no_comment(tmp_path: Path) -> None:
    file = tmp_path / "test.csv"
    bad = "A\x1b[2J\u2028x"
    file.write_text(f"{HEADER}{bad},0,47,8,100\n{bad},9,47,8.01,100\n", encoding="utf-8")
    made = import_traffic(file)
    assert "\x1b" not in made.toml + "".join(made.lines())
    out = tmp_path / "test.toml"
    out.write_text(made.toml, encoding="utf-8")
    assert load_scenario(out) == made.scenario


def test_a_hundred_thousand_lines_are_read_in_seconds(tmp_path: Path) -> None:
    """100 aircraft of 1000 rows each, that wiggle by less than the tolerance."""
    file = tmp_path / "test.csv"
    rows = [
        f"A{a},{t},{47.0 + 0.01 * a + (t % 7) * 1e-5:.6f},{8.0 + t * 3e-4:.6f},100\n"
        for t in range(1000)
        for a in range(100)
    ]
    file.write_text(HEADER + "".join(rows), encoding="utf-8")
    began = time.process_time()
    made = import_traffic(file)
    assert time.process_time() - began < 30.0
    assert len(made.uavs) == 100
    assert all(len(u.waypoints_ned_m) == 1 for u in made.uavs)


def test_a_flight_of_too_many_corners_is_left_out_and_takes_no_long_time(tmp_path: Path) -> None:
    file = tmp_path / "test.csv"
    rows = [f"A,{t},{47.0 + (t % 2) * 2e-3},{8.0 + t * 3e-5},100\n" for t in range(20_000)]
    file.write_text(f"{HEADER}{''.join(rows)}B,0,47,8,100\nB,9,47,8.01,100\n", encoding="utf-8")
    began = time.process_time()
    made = import_traffic(file)
    assert time.process_time() - began < 10.0
    assert [uav.name for uav in made.uavs] == ["B"]
    assert "A: needs more than 998 waypoints; left out, unless --tol" in "".join(made.lines())


def test_more_aircraft_than_a_scenario_has_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "test.csv"
    rows = [
        f"A{a},{t},{40.0 + 1e-3 * a},{8.0 + 1e-3 * t},100\n" for a in range(1001) for t in (0, 9)
    ]
    file.write_text(HEADER + "".join(rows), encoding="utf-8")
    with pytest.raises(ScenarioError, match="1001 aircraft, and a scenario has at most 1000; choo"):
        import_traffic(file)


TEXT = """00:00:00.00>CRE AC1 AC2 A320 0 0.5 -91 1e400 nan FL FL100 M0.8 HDG ALT VS SPD ADDWPT
DEST DEFWPT CRECONFS BANK ZONER DTLOOK , ,, ' \\ # ; NAME lat lon alt sx sy sz trk gs time [deg]
[ft] [none] [nmi] [s] id time_s lat_deg lon_deg alt_m 47 8 100 -5 1e308"""
WORDS = st.sampled_from(TEXT.split())
LINE = st.lists(WORDS, max_size=9).map(" ".join)
STARTS = {
    ".scn": "00:00:00.00>CRE AC1,A320,0,0,90,FL100,250\n00:00:01.00>CRE AC2,A320,0,1,270,0,250\n",
    ".daa": "NAME lat lon alt trk gs vs time\n[none] [deg] [deg] [ft] [deg] [kn] [fpm] [s]\n",
    ".csv": HEADER + ROW,
}


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(sorted(STARTS)), st.lists(LINE, max_size=8), st.booleans())
def test_whatever_is_written_there_it_is_a_scenario_or_a_line(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, lines: list[str], begun: bool
) -> None:
    file = tmp_path_factory.mktemp("any") / f"test{suffix}"
    timed = [f"00:00:0{n}.00>{x}" if suffix == ".scn" else x for n, x in enumerate(lines)]
    text = (STARTS[suffix] if begun else "") + "\n".join(timed)
    if suffix == ".csv":
        text = text.replace(" ", ",")
    file.write_text(text, encoding="utf-8")
    try:
        made = import_traffic(file)
    except ScenarioError as error:
        told = str(error)
    else:
        told = str(made)
        assert len(made.scenario.uav) == len(made.uavs) > 0
    assert "\n" not in told


def test_a_scenario_that_could_not_be_read_again_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "test.csv"
    file.write_text(f"{HEADER}{ROW}A,9,47,8.01,100\n", encoding="utf-8")
    monkeypatch.setattr("fleet.imports.scenario_making.MAX_BYTES", 500)
    with pytest.raises(ScenarioError, match="MiB; choose aircraft with --only NAME, or widen --"):
        import_traffic(file)


def test_without_pyproj_the_command_that_installs_it_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "test.csv"
    file.write_text(f"{HEADER}{ROW}A,9,47,8.01,100\n", encoding="utf-8")
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'zenoh-fleet\[tracks\]'"):
        import_traffic(file)
