"""Recorded flights of CSV and DAIDALUS: plans, closest points, and what is said of the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.scenario import Scenario
from fleet.imports.approach import latest_approach_s
from fleet.imports.importing import import_traffic
from fleet.imports.recorded_flight import Tolerance3D, corners_of
from fleet.imports.scenario_making import ImportedTraffic
from fleet.model.types import Array
from tests.support.ellipsoid import GeodesicFlight, nearest_by_ecef, nearest_of_import

FOOT, KNOT, MILE = 0.3048, 1852.0 / 3600.0, 1852.0
HEADER = "id,time_s,lat_deg,lon_deg,alt_m\n"


def imported(text: str, folder: Path, suffix: str = ".csv", **more: object) -> ImportedTraffic:
    file = folder / f"test{suffix}"
    file.write_text(text, encoding="utf-8")
    return import_traffic(file, **more)  # type: ignore[arg-type]


def said(made: ImportedTraffic) -> str:
    return "\n".join(made.lines())


def csv_of(flights: dict[str, GeodesicFlight], until_s: float, every_s: float = 1.0) -> str:
    times = np.arange(0.0, until_s + every_s / 2.0, every_s)
    rows = [
        f"{name},{time:.3f},{lat:.9f},{lon:.9f},{alt:.4f}\n"
        for name, flight in flights.items()
        for time, (lat, lon, alt) in zip(times, flight.geodetic(times), strict=True)
    ]
    return HEADER + "".join(rows)


def daa_of(flights: dict[str, GeodesicFlight], times: Sequence[float]) -> str:
    """The same with feet, knots and feet a minute, as DAIDALUS has them."""
    rows = [
        f"{name}, {lat:.9f}, {lon:.9f}, {alt / FOOT:.3f}, {f.course:.6f}, {f.speed / KNOT:.6f}, "
        f"{f.climb / FOOT * 60.0:.4f}, {time:.2f}\n"
        for time in times
        for name, f in flights.items()
        for lat, lon, alt in f.geodetic(np.array([time]))
    ]
    names = "NAME lat lon alt trk gs vs time\n"
    return f"# made\n{names}[none] [deg] [deg] [ft] [deg] [knot] [fpm] [s]\n{''.join(rows)}"


MEETING = {
    "OWN": GeodesicFlight(47.0, 8.0, 120.0, 90.0, 20.0),
    "INTRUDER": GeodesicFlight(47.0, 8.03, 90.0, 270.0, 15.0, 0.5),
}


def test_a_straight_record_is_a_start_and_one_waypoint(tmp_path: Path) -> None:
    made = imported(csv_of(MEETING, 60.0), tmp_path, origin=(47.0, 8.0, 100.0))
    own, intruder = made.scenario.uav
    assert own.position_ned_m == pytest.approx((0.0, 0.0, -20.0), abs=1e-3)
    assert (own.heading_deg, own.speed_mps) == pytest.approx((90.0, 20.0), abs=1e-2)
    # 60 s on record and 30 s beyond.
    assert len(own.waypoints_ned_m) == 1
    assert own.waypoints_ned_m[0] == pytest.approx((0.0, 1800.0, -20.0), abs=0.1)
    assert intruder.climb_mps == pytest.approx(0.5, abs=1e-3)
    assert intruder.guidance_climb_mps == pytest.approx(0.5, abs=1e-3)
    assert math.hypot(*intruder.state().velocity_ned_mps[:2]) == pytest.approx(15.0, abs=1e-2)
    assert made.lines() == []
    assert made.scenario.zone == Scenario("x", 1.0).zone


@settings(max_examples=20, deadline=None)
@given(
    st.floats(-70.0, 70.0),
    st.floats(-180.0, 180.0),
    st.floats(0.0, 359.0),
    st.floats(20.0, 340.0),
    st.floats(10.0, 60.0),
    st.floats(10.0, 60.0),
    st.floats(-2.0, 2.0),
    st.sampled_from([".csv", ".daa"]),
)
def test_the_closest_point_is_that_of_the_record(
    tmp_path_factory: pytest.TempPathFactory,
    latitude: float,
    longitude: float,
    course: float,
    turn: float,
    fast: float,
    slow: float,
    climb: float,
    suffix: str,
) -> None:
    """Within 5 cm + 0.05 % and 50 ms, of flights of 60 s that pass near each other."""
    one = GeodesicFlight(latitude, longitude, 500.0, course, fast, climb)
    level = GeodesicFlight(latitude, longitude, 0.0, course, fast)
    lat, lon, _ = level.geodetic(np.array([30.0]))[0]
    away = GeodesicFlight(lat, lon, 0.0, course + turn + 180.0, slow)
    lat, lon, _ = away.geodetic(np.array([27.0]))[0]
    two = GeodesicFlight(lat, lon, 520.0, course + turn, slow)
    flights = {"A": one, "B": two}
    times = [float(t) for t in range(61)]
    text = csv_of(flights, 60.0) if suffix == ".csv" else daa_of(flights, times)
    made = imported(text, tmp_path_factory.mktemp("record"), suffix, tolerance_m=(1.0, 0.01))
    ((time, distance),) = nearest_of_import(made).values()
    true_s, true_m = nearest_by_ecef(one, two, 120.0)
    if true_s < 55.0:
        assert distance == pytest.approx(true_m, rel=5e-4, abs=0.05)
        assert time == pytest.approx(true_s, abs=0.05)


def test_a_record_that_turns_becomes_waypoints_within_the_tolerance(tmp_path: Path) -> None:
    """East for 1 km, then north: the corner is kept, and nothing else."""
    east = GeodesicFlight(47.0, 8.0, 100.0, 90.0, 20.0)
    times = np.arange(0.0, 51.0)
    first = east.geodetic(times)
    north = GeodesicFlight(first[-1][0], first[-1][1], 100.0, 0.0, 20.0)
    rows = [*first, *north.geodetic(times)[1:]]
    text = HEADER + "".join(
        f"A,{n},{lat:.9f},{lon:.9f},{alt}\n" for n, (lat, lon, alt) in enumerate(rows)
    )
    made = imported(text, tmp_path, origin=(47.0, 8.0, 0.0))
    (uav,) = made.scenario.uav
    corner, last = uav.waypoints_ned_m
    assert corner == pytest.approx((0.0, 1000.0, -100.0), abs=0.2)
    assert last == pytest.approx((1600.0, 1000.0, -100.0), abs=0.5)


@pytest.mark.parametrize("across", [5.0, 20.0])
def test_a_record_that_circles_is_flown_round(across: float, tmp_path: Path) -> None:
    """Three rounds of 150 m at 20 m/s: everywhere within two tolerances, at the same time too."""
    times = np.arange(0.0, 142.0)
    turned = times * 20.0 / 150.0
    north, east = 150.0 * np.sin(turned), 150.0 * (1.0 - np.cos(turned))
    latitude, longitude = 47.0 + north / 111_170.0, 8.0 + east / 76_056.0
    rows = zip(times, latitude, longitude, strict=True)
    text = HEADER + "".join(f"A,{t},{lat:.9f},{lon:.9f},100\n" for t, lat, lon in rows)
    made = imported(text, tmp_path, tolerance_m=(across, 5.0), origin=(47.0, 8.0, 0.0))
    (uav,), s = made.scenario.uav, made.scenario
    pilot, plan, state = s.pilot(1, uav.speed_mps), uav.plan(), uav.state()
    for n in range(1, len(times)):
        plan, states = pilot.follow(plan, state, 1_000_000_000)
        state = states[-1]
        assert math.dist(state.position_ned_m[:2], (north[n], east[n])) < 2.0 * across
    assert made.lines() == ["test.csv: A: the only aircraft; there is nobody to avoid"]


def test_corners_that_are_cut_are_said(tmp_path: Path) -> None:
    """A zigzag of 300 m beside an aircraft of 250 m/s, whose turns are so wide."""
    fast = csv_of({"B": GeodesicFlight(47.1, 8.0, 100.0, 0.0, 250.0)}, 40.0)
    rows = [
        f"A,{t},{47.0 + (t // 10 % 2) * 2e-3:.6f},{8.0 + t * 3e-4:.6f},100\n"
        for t in range(0, 41, 10)
    ]
    made = imported(fast + "".join(rows), tmp_path)
    assert "line 43: A: corners only 319 m apart; a waypoint is reached within 1105 m" in said(made)


@given(
    st.lists(st.tuples(*[st.floats(-1000.0, 1000.0)] * 3), min_size=2, max_size=40),
    st.floats(1.0, 200.0),
    st.floats(1.0, 50.0),
)
def test_no_place_is_beyond_the_tolerance_from_the_legs(
    places: list[tuple[float, float, float]], across: float, up: float
) -> None:
    points, tolerance = np.array(places), Tolerance3D(across, up)
    kept = corners_of(points, tolerance)
    assert kept[0] == 0
    assert kept[-1] == len(points) - 1
    for first, last in pairwise(kept):
        for n in range(first + 1, last):
            share = (n - first) / (last - first)
            assert _within(points[n], points[first], points[last], tolerance, share)


def _within(place: Array, start: Array, end: Array, tolerance: Tolerance3D, share: float) -> bool:
    way = end - start
    squared = way[0] ** 2 + way[1] ** 2
    if squared > 0.0:
        share = min(1.0, max(0.0, ((place - start)[:2] @ way[:2]) / squared))
    off = place - (start + share * way)
    return bool(
        math.hypot(off[0], off[1]) <= tolerance.across_m * (1 + 1e-9) + 1e-9
        and abs(off[2]) <= tolerance.up_m * (1 + 1e-9) + 1e-9
    )


def test_units_and_columns_of_daidalus(tmp_path: Path) -> None:
    """Columns of a plane: sx is east; velocities vx, vy, vz; quotes for the name once more."""
    made = imported(
        "a = 5 [m]\nNAME sx sy sz vx vy vz time\n[none] [km] [m] [ft] [m/s] [kn] [fpm] [s]\n"
        'Own, 0, 0, 1000, 50, 0, 0, 0\n", 0.05, 0, 1000, 50, 0, 0, 1\n'
        "Other 2 500 1000 0 100 60 0\n",
        tmp_path,
        ".daa",
    )
    own, other = made.scenario.uav
    assert own.position_ned_m == pytest.approx((0.0, 0.0, -304.8))
    assert (own.heading_deg, own.speed_mps) == pytest.approx((90.0, 50.0))
    assert other.position_ned_m == pytest.approx((500.0, 2000.0, -304.8))
    assert other.state().velocity_ned_mps == pytest.approx((100 * KNOT, 0.0, -0.3048), abs=1e-4)
    assert said(made) == (
        "test.daa: line 6: Other: ends 1 s before the last aircraft; it flies straight on\n"
        "test.daa: 1 parameters: settings of DAIDALUS, not taken over"
    )


def test_without_a_line_of_units_they_are_those_of_daidalus_which_is_said(tmp_path: Path) -> None:
    made = imported(
        "NAME lat lon alt trk gs vs\nA 47 8 1000 90 100 0\nB 47 8.1 1000 270 100 0\n",
        tmp_path,
        ".daa",
    )
    a, _ = made.scenario.uav
    assert a.position_ned_m[2] == pytest.approx(-304.8)
    assert a.speed_mps == pytest.approx(100.0 * KNOT)
    # 7.6 km at 2 x 51.4 m/s: 74 s to the closest point, a tenth more, 30 s, and T_s of 120 s.
    assert made.scenario.duration_s == 240.0
    assert "line 2: units: no line of them; taken as DAIDALUS does: lat [deg]" in said(made)


def test_a_velocity_in_parts_is_the_same_as_course_and_speed(tmp_path: Path) -> None:
    """Of one state each, far from the origin, where true north is not that of the frame."""
    head = "[none] [deg] [deg] [m] {} [m/s] [m/s]\n"
    first = f"NAME lat lon alt trk gs vs\n{head.format('[deg]')}"
    second = f"NAME lat lon alt vx vy vz\n{head.format('[m/s]')}"
    other = "B 60.5 15 500 {}\n"
    whole = imported(
        f"{first}A 60 10 500 30 50 1\n{other.format('0 10 0')}", tmp_path, ".daa"
    ).scenario.uav
    east, north = 50.0 * math.sin(math.radians(30.0)), 50.0 * math.cos(math.radians(30.0))
    parts = imported(
        f"{second}A 60 10 500 {east!r} {north!r} 1\n{other.format('0 10 0')}", tmp_path, ".daa"
    ).scenario.uav
    assert parts[0].heading_deg == pytest.approx(whole[0].heading_deg, abs=1e-4)
    assert parts[0].speed_mps == pytest.approx(whole[0].speed_mps, abs=1e-5)
    assert abs(whole[0].heading_deg - 30.0) > 1.0
    assert whole[0].climb_mps == pytest.approx(1.0, abs=1e-5)


def test_rows_may_come_in_any_order(tmp_path: Path) -> None:
    head, *rows = csv_of(MEETING, 60.0).splitlines(keepends=True)
    whole = imported(head + "".join(rows), tmp_path)
    mixed = imported(head + "".join(sorted(rows, key=lambda row: row[::-1])), tmp_path)
    by_name = {a.name: a.waypoints_ned_m for a in mixed.uavs}
    assert by_name == {a.name: a.waypoints_ned_m for a in whole.uavs}


def test_the_latest_closest_point_is_of_those_that_meet() -> None:
    """Two meet after 50 s; one flies nearly abreast of the first, and meets it after 10 hours."""
    places = np.array([[0.0, 0.0], [1000.0, 0.0], [0.0, 3600.0]])
    velocities = np.array([[10.0, 0.0], [-10.0, 0.0], [10.0, -0.1]])
    assert latest_approach_s(places, velocities, 500.0) == pytest.approx(50.0)
    assert latest_approach_s(places[[0, 2]], velocities[[0, 2]], 500.0) == 0.0


def test_who_appears_later_or_ends_earlier_flies_straight_on_beyond(tmp_path: Path) -> None:
    times = np.arange(0.0, 61.0)
    rows = csv_of({"A": MEETING["OWN"]}, 60.0)
    flight = MEETING["INTRUDER"]
    for time in times[20:40]:
        ((lat, lon, alt),) = flight.geodetic(np.array([time]))
        rows += f"B,{time},{lat:.9f},{lon:.9f},{alt:.4f}\n"
    made = imported(rows, tmp_path)
    whole = imported(csv_of(MEETING, 60.0), tmp_path, origin=made.origin)
    late, all_the_time = made.scenario.uav[1], whole.scenario.uav[1]
    assert late.position_ned_m[:2] == pytest.approx(all_the_time.position_ned_m[:2], abs=0.05)
    assert late.waypoints_ned_m[0] == pytest.approx(
        (*_place(whole, flight, 20.0), -100.0), abs=0.05
    )
    assert "B: appears 20 s after the first aircraft; it begins with all others, 300 m" in said(
        made
    )
    assert "B: ends 21 s before the last aircraft; it flies straight on" in said(made)


def _place(made: ImportedTraffic, flight: GeodesicFlight, time: float) -> tuple[float, float]:
    from fleet.imports.local_frame import LocalFrame

    ((lat, lon, _),) = flight.geodetic(np.array([time]))
    return LocalFrame(made.origin).point_m(lat, lon)


def test_speeds_and_climbs_that_are_not_flown_so_are_said(tmp_path: Path) -> None:
    rows = HEADER
    for n in range(0, 121, 2):
        north = 20.0 * min(n, 60) + 30.0 * max(0, n - 60)
        up = 100.0 + 2.0 * max(0, n - 60)
        rows += (
            f"A,{n},{47.0 + north / 111_170.0:.9f},8.0,{up}\nB,{n},47.0,{8.2 + n * 3e-4:.6f},200\n"
        )
    made = imported(rows, tmp_path)
    assert "A: flies 20.0 to 30.1 m/s; a UAV at one speed, 25.0 m/s" in said(made)
    assert "A: climbs or sinks by 0.0 to 2.0 m/s on 2 legs" in said(made)


def test_settings_suit_who_flies(tmp_path: Path) -> None:
    """Slow ones climb less; who climbs steeply has a performance of its own."""
    steep = GeodesicFlight(47.0, 8.0, 100.0, 0.0, 10.0, 6.0)
    made = imported(csv_of({"A": steep, "B": MEETING["OWN"]}, 30.0), tmp_path)
    s = made.scenario
    assert s.uav[0].performance is not None
    assert s.uav[1].performance is None
    assert s.resolution.max_climb_mps <= s.uav[0].speed_mps * math.sin(math.radians(15.0))
    with_zone = imported(csv_of(MEETING, 60.0), tmp_path, zone=(50.0, 10.0), duration_s=42.0)
    assert (with_zone.scenario.zone.radius_m, with_zone.scenario.duration_s) == (50.0, 42.0)
    chosen = imported(csv_of(MEETING, 60.0), tmp_path, only=["INTRUDER"])
    assert [u.name for u in chosen.uavs] == ["INTRUDER"]
