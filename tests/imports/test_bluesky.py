"""BlueSky scenarios: what their commands make of aircraft, and what is said of the rest."""

from __future__ import annotations

import math
from pathlib import Path

import pyproj
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.errors import ScenarioError
from fleet.imports.bluesky_text import arguments_of, latitude_deg, longitude_deg
from fleet.imports.importing import import_traffic
from fleet.imports.scenario_making import ImportedTraffic
from tests.support.ellipsoid import GeodesicFlight, nearest_by_ecef, nearest_of_import

FOOT, KNOT, MILE = 0.3048, 1852.0 / 3600.0, 1852.0
LOW_FT = 0.0
"""At sea level calibrated airspeed is true airspeed."""


def imported(text: str, folder: Path, **more: object) -> ImportedTraffic:
    file = folder / "test.scn"
    file.write_text(text, encoding="utf-8")
    return import_traffic(file, **more)  # type: ignore[arg-type]


def said(made: ImportedTraffic) -> str:
    return "\n".join(made.lines())


def test_a_created_aircraft_flies_straight_on(tmp_path: Path) -> None:
    made = imported("00:00:00.00>CRE AB1,B744,52.0,4.0,90,0,200\n", tmp_path)
    (uav,) = made.scenario.uav
    assert (made.origin.latitude_deg, made.origin.longitude_deg) == (52.0, 4.0)
    assert uav.position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert uav.heading_deg == pytest.approx(90.0, abs=0.01)
    assert uav.speed_mps == pytest.approx(200.0 * KNOT, abs=1e-4)
    assert made.uavs[0].name == "AB1"
    assert made.scenario.zone.radius_m == pytest.approx(2.5 * MILE)
    assert made.scenario.zone.half_height_m == pytest.approx(500.0 * FOOT)
    assert said(made) == "test.scn: AB1: the only aircraft; there is nobody to avoid"


@settings(max_examples=40, deadline=None)
@given(
    st.floats(-70.0, 70.0),
    st.floats(-179.0, 179.0),
    st.floats(0.0, 359.0),
    st.floats(30.0, 330.0),
    st.floats(150.0, 400.0),
    st.floats(150.0, 400.0),
    st.floats(60.0, 300.0),
    st.floats(-3.0, 3.0),
)
def test_the_closest_point_is_that_of_geodesics_on_the_ellipsoid(
    tmp_path_factory: pytest.TempPathFactory,
    latitude: float,
    longitude: float,
    course: float,
    turn: float,
    fast: float,
    slow: float,
    ahead_s: float,
    miss_km: float,
) -> None:
    """Two that meet near a point: 50 m and 0.2 s, of ways of 30 to 200 km."""
    geod = pyproj.Geod(ellps="WGS84")
    flights = []
    for knots, away, side in ((fast, 0.0, 0.0), (slow, turn, miss_km * 1000.0)):
        back = knots * KNOT * ahead_s
        lon, lat, _ = geod.fwd(longitude, latitude, course + away + 90.0, side)
        lon, lat, to_goal = geod.fwd(lon, lat, course + away + 180.0, back)
        flights.append(GeodesicFlight(lat, lon, 0.0, to_goal, knots * KNOT))
    text = "".join(
        f"00:00:00.00>CRE AC{n},A320,{f.latitude:.9f},{f.longitude:.9f},{f.course:.9f},0,"
        f"{f.speed / KNOT:.9f}\n"
        for n, f in enumerate(flights)
    )
    made = imported(text, tmp_path_factory.mktemp("scn"))
    ((time, distance),) = nearest_of_import(made).values()
    true_s, true_m = nearest_by_ecef(flights[0], flights[1], 2.0 * ahead_s + 60.0)
    assert time == pytest.approx(true_s, abs=0.2)
    assert distance == pytest.approx(true_m, abs=50.0 if true_m > 100.0 else 5.0)


def test_climbs_begin_at_once_at_the_rate_that_is_told(tmp_path: Path) -> None:
    made = imported(
        "00:00:00.00>CRE LOW,A320,0,0,0,FL100,300\n"
        "00:00:00.00>VS LOW,1968.5039\n"
        "00:00:00.00>ALT LOW,FL200\n"
        "00:00:00.00>CRE HIGH,A320,1,0,180,FL200,300\n"
        "00:00:00.00>ALT HIGH,FL100,-1000\n",
        tmp_path,
    )
    low, high = made.scenario.uav
    assert (low.climb_mps, low.guidance_climb_mps) == pytest.approx((10.0, 10.0), abs=1e-5)
    assert low.waypoints_ned_m[-1][2] == pytest.approx(-20_000.0 * FOOT, abs=1e-3)
    assert low.state().velocity_ned_mps[2] == pytest.approx(-10.0, abs=1e-5)
    # 300 kt at 10,000 ft are 345 kt over ground, in the climb too.
    assert math.hypot(*low.state().velocity_ned_mps[:2]) == pytest.approx(345.0 * KNOT, abs=1.0)
    level = imported("00:00:00.00>CRE LOW,A320,0,0,0,FL100,300\n", tmp_path).scenario.uav[0]
    assert math.hypot(*low.state().velocity_ned_mps[:2]) == pytest.approx(level.speed_mps)
    assert made.scenario.resolution.max_altitude_m == math.ceil(20_000.0 * FOOT + 1000.0)
    assert high.climb_mps == pytest.approx(-1000.0 * FOOT / 60.0, abs=1e-5)


def test_a_vertical_speed_the_other_way_counts_for_none(tmp_path: Path) -> None:
    made = imported(
        "00:00:00.00>CRE AC1,A320,0,0,0,FL100,300\n00:00:00.00>VS AC1,-600\n"
        "00:00:00.00>ALT AC1,FL200\n",
        tmp_path,
    )
    assert made.scenario.uav[0].climb_mps == pytest.approx(1500.0 * FOOT / 60.0, abs=1e-5)


def test_a_later_command_acts_where_the_aircraft_is_by_then(tmp_path: Path) -> None:
    made = imported(
        "00:00:00.00>CRE AC1,A320,0,0,90,0,194.384449\n"  # 100 m/s
        "00:01:40.00>HDG AC1,180\n"
        "00:02:00.00>ALT AC1,3280.84\n",
        tmp_path,
        origin=(0.0, 0.0, 0.0),
    )
    (uav,) = made.scenario.uav
    turn, climb, last = uav.waypoints_ned_m
    assert turn == pytest.approx((0.0, 10_000.0, 0.0), abs=0.1)
    assert climb == pytest.approx((-2000.0, 10_000.0, 0.0), abs=0.1)
    assert last[2] == pytest.approx(-1000.0, abs=0.01)
    assert last[1] == pytest.approx(10_000.0, abs=0.1)
    assert uav.climb_mps == 0.0
    assert uav.guidance_climb_mps == pytest.approx(1500.0 * FOOT / 60.0, abs=1e-5)


def test_routes_are_flown_and_the_destination_stays_last(tmp_path: Path) -> None:
    made = imported(
        "00:00:00.00>CRE AC1 A320 0 0 90 FL50 250\n"
        "00:00:00.00>DEFWPT GOAL,0,1.0\n"
        "00:00:00.00>DEST AC1 5,5\n00:00:00.00>AC1 DEST GOAL\n"
        "00:00:00.00>ADDWPT AC1 0.1 , 0.2\n"
        "00:00:00.00>AC1 ADDWPT N0'12', E0'24' FL60\n"
        "00:00:00.00>ADDWPT AC1 FLYOVER\n"
        "00:00:00.00>ADDWPT AC1 SUGOL\n",
        tmp_path,
        origin=(0.0, 0.0, 0.0),
    )
    (uav,) = made.scenario.uav
    across = [(n, e) for n, e, _ in uav.waypoints_ned_m]
    degrees = [(0.1, 0.2), (0.2, 0.4), (0.0, 1.0)]
    expected = [(lat * 110_574.3, lon * 111_319.5) for lat, lon in degrees]
    assert [x for p in across for x in p] == pytest.approx(
        [x for p in expected for x in p], abs=5.0
    )
    # It climbs to the altitude ahead at once, and keeps it.
    assert [-d for _, _, d in uav.waypoints_ned_m] == pytest.approx([6000 * FOOT] * 3, abs=1e-3)
    assert "line 7: ADDWPT AC1: FLYOVER: how waypoints are passed" in said(made)
    assert "line 8: ADDWPT AC1: 'SUGOL' is not defined in the file" in said(made)
    assert "line 3: DEST AC1: taken for a waypoint" in said(made)


def test_an_aircraft_in_conflict_meets_its_target_when_it_is_told(tmp_path: Path) -> None:
    """Separation of 5 NM is lost after 120 s, and the closest point is 1 NM away."""
    made = imported(
        "00:00:00.00>CRE AC1,A320,0,0,0,0,194.384449\n"
        "00:00:00.00>CRECONFS AC2,A320,AC1,90,1.0,120\n",
        tmp_path,
    )
    ((time, distance),) = nearest_of_import(made).values()
    assert distance == pytest.approx(1852.0, abs=5.0)
    closing = 100.0 * math.sqrt(2.0)
    assert time == pytest.approx(120.0 + math.sqrt(25.0 - 1.0) * MILE / closing, abs=0.05)


def test_who_is_created_later_begins_further_back(tmp_path: Path) -> None:
    made = imported(
        "00:00:10.00>CRE AC1,A320,0,0,90,0,194.384449\n"
        "00:00:40.00>CRE AC2,A320,0,1,270,0,194.384449\n",
        tmp_path,
        origin=(0.0, 0.0, 0.0),
    )
    first, second = made.scenario.uav
    assert first.position_ned_m[1] == pytest.approx(0.0, abs=1e-3)
    assert second.position_ned_m[1] == pytest.approx(111_319.5 + 3000.0, abs=1.0)
    assert "line 2: CRE AC2: created 30 s after the first aircraft; it begins" in said(made)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("WIND 0,0,,180,25", "line 3: WIND 0: there is no wind here"),
        ("SPD AC1 250", "line 3: SPD AC1: flown at 128.6 m/s from the start"),
        ("HDG AC1 M090", "line 3: HDG AC1: 'M090' is a magnetic heading"),
        ("HDG AC7 090", "line 3: HDG AC7: no such aircraft has been created"),
        ("AC1 ATALT FL200 HDG AC1 90", "line 3: ATALT AC1: a condition"),
        ("CRE AC1,B744,5,5,0,0,200", "line 3: CRE AC1: there is an aircraft of this name"),
        ("CRE AC3,B744,5,5,0,0,0", "line 3: AC3: stationary, at 0 m/s"),
        ("CRE AC3,B744,5,5,0,0,1900", "line 3: AC3: flies 977 m/s, and a UAV at most 500 m/s"),
        ("CRE AC3,B744,91,5,0,0,200", "line 3: CRE AC3: '91' is out of range"),
        ("CRE AC3,B744,nan,5,0,0,200", "line 3: CRE AC3: 'nan' is not defined in the file"),
        ("CRE AC3,B744,5,5,0,nan,200", "line 3: CRE AC3: 'nan' is out of range"),
        ("CRE AC3,B744,EHAM,0,0,200", "line 3: CRE AC3: 'EHAM' is not defined"),
        ("CRE AC3,B744,0,0,45,0,200", "line 3: AC3: begins at the place of AC1; left out"),
        ("CRE AC3,B744,40,0,45,0,200", "line 3: AC3: comes 4452 km from the origin"),
        ("SYN SUPER 8;TRAILS ON", "line 3: SYN SUPER: a program that makes aircraft"),
        ("DEL AC1", "line 3: DEL AC1: a UAV stays to the end"),
        ("ECHO meet at 5 min", "ECHO (1): show, pace, record or name"),
        ("RESO MVP", "RESO (1): settings of BlueSky's own avoidance"),
        ("FF_SNAP EVERYTHING", "FF_SNAP (1): not known here"),
        ("ZONER 2,AC1", "line 3: ZONER 2: a zone of some aircraft alone"),
        ("LNAV AC1 OFF", "line 3: LNAV AC1: a UAV flies its waypoints"),
    ],
)
def test_what_is_not_taken_over_is_said_with_its_line(line: str, why: str, tmp_path: Path) -> None:
    base = "00:00:00.00>CRE AC1,A320,0,0,90,0,200\n00:00:00.00>CRE AC2,A320,0,0.5,270,0,200\n"
    made = imported(f"{base}00:00:00.00>{line}\n", tmp_path, origin=(0.0, 0.0, 0.0))
    assert len(made.uavs) == 2
    assert why in said(made)


def test_lines_that_are_no_commands_are_said_and_comments_are_not(tmp_path: Path) -> None:
    made = imported(
        "# a comment\n\n00:00:00.00>CRE AC1,A320,0,0,90,0,200 # one\nnot a command at all\n"
        "00:00:00.00>CRE AC2,A320, \\\n  0,1,270,0,200\n",
        tmp_path,
    )
    assert [u.name for u in made.uavs] == ["AC1", "AC2"]
    assert said(made) == (
        "test.scn: line 4: not a command at all: not HH:MM:SS.hh>COMMAND; BlueSky leaves it aside"
    )


def test_zone_look_ahead_and_bank_are_taken_over(tmp_path: Path) -> None:
    made = imported(
        "00:00:00.00>ZONER 3\n00:00:00.00>ZONEDH 500\n00:00:00.00>DTLOOK 120\n"
        "00:00:00.00>CRE AC1,A320,0,0,90,0,200\n00:00:00.00>BANK AC1,35\n"
        "00:00:00.00>CRE AC2,A320,0,1,270,0,200\n",
        tmp_path,
    )
    s = made.scenario
    assert (s.zone.radius_m, s.zone.half_height_m) == pytest.approx((1.5 * MILE, 250.0 * FOOT))
    assert s.resolution.horizon_s == 120.0
    assert [getattr(s.performance_of(u), "max_bank_deg") for u in (1, 2)] == [35.0, 25.0]  # noqa: B009


def test_a_file_of_which_nobody_can_fly_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"no aircraft can be taken over: line 1: AC1: station"):
        imported("00:00:00.00>CRE AC1,A320,0,0,90,0,0\n", tmp_path)


def test_words_and_angles_are_read_as_bluesky_reads_them() -> None:
    assert [*arguments_of("CRE AC1, B744 0. , 4,,FL200")] == [
        *("CRE", "AC1", "B744", "0.", "4", "", "FL200")
    ]
    assert latitude_deg("S52'30'36") == pytest.approx(-(52.0 + 30.0 / 60.0 + 36.0 / 3600.0))
    assert longitude_deg("W004'15'") == pytest.approx(-4.25)
    assert longitude_deg("190") == pytest.approx(-170.0)
