"""Rows of states, as files of recorded flights have them: checked, and put together by aircraft."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fleet.config.scenario import Origin, Point
from fleet.errors import ScenarioError
from fleet.imports.imported import ForeignTraffic
from fleet.imports.local_frame import LocalFrame, middle_of
from fleet.imports.recorded_flight import RecordedFlight, Tolerance3D, take_flights
from fleet.model.types import Array

BOUNDS = {"lat": 90.0, "lon": 360.0, "alt": 1e5, "sz": 1e5, "time": 1e10}
"""The greatest value of some columns, in degrees, m and s, either sign."""


@dataclass(frozen=True, slots=True)
class StateRow:
    """One aircraft at one time: numbers by column in degrees, m, m/s and s.

    The columns are lat, lon, alt or sx (east), sy (north), sz (up); time; and, if the file has
    them, trk, gs, vs or vx (east), vy (north), vz (up).
    """

    line: int
    name: str
    values: dict[str, float]


def number_in(text: str, factor: float, column: str, where: str) -> float:
    """A number of a column, times a factor; raises ScenarioError for what is none, or no place."""
    try:
        value = float(text) * factor
    except ValueError:
        what = f"'{text[:20]}' is no number" if text else "no value"
        raise ScenarioError(f"{where}: {column}: {what}; give a number") from None
    if not math.isfinite(value):
        raise ScenarioError(f"{where}: {column}: '{text[:20]}' is no finite number; give one")
    if abs(value) > BOUNDS.get(column, 1e9):
        raise ScenarioError(f"{where}: {column}: {text[:20]} is out of range; look at its unit")
    return value


def take_rows(
    rows: Sequence[StateRow],
    source: str,
    traffic: ForeignTraffic,
    origin: Origin | None,
    tolerance: Tolerance3D | None,
) -> None:
    """Add the flights of a file to its traffic; raises ScenarioError as `flights_of_rows`."""
    flights = flights_of_rows(rows, source, traffic, origin)
    take_flights(flights, traffic, tolerance or Tolerance3D.of(traffic.settings.zone))


def flights_of_rows(
    rows: Sequence[StateRow], source: str, traffic: ForeignTraffic, origin: Origin | None
) -> list[RecordedFlight]:
    """The flights in the order in which aircraft come first; sets the origin of the traffic.

    Raises:
        ScenarioError: one aircraft is at two places at one time, or nothing says how it moves.

    """
    if not rows:
        raise ScenarioError(f"{source}: no row of states under its line of columns")
    geodetic = "lat" in rows[0].values
    frame = None
    if geodetic:
        latitudes, longitudes = ([row.values[c] for row in rows] for c in ("lat", "lon"))
        frame = LocalFrame(origin or middle_of(latitudes, longitudes))
        traffic.origin = frame.origin
    else:
        traffic.origin = origin or Origin(altitude_m=0.0)
    places = _places(rows, frame, traffic.origin)
    by_name: dict[str, list[int]] = {}
    for n, row in enumerate(rows):
        by_name.setdefault(row.name, []).append(n)
    return [_flight(rows, places, numbers, source, frame) for numbers in by_name.values()]


def _places(rows: Sequence[StateRow], frame: LocalFrame | None, origin: Origin) -> Array:
    """NED of all rows."""
    columns = ("lat", "lon", "alt") if frame else ("sy", "sx", "sz")
    first, second, up = (np.array([row.values[c] for row in rows]) for c in columns)
    if frame:
        return frame.ned_m(first, second, up)
    return np.column_stack([first, second, origin.altitude_m - up]) + 0.0


def _flight(
    rows: Sequence[StateRow],
    places: Array,
    numbers: list[int],
    source: str,
    frame: LocalFrame | None,
) -> RecordedFlight:
    """That of the aircraft to which these rows belong."""
    order = sorted(numbers, key=lambda n: rows[n].values["time"])
    for before, after in pairwise(order):
        if rows[before].values["time"] == rows[after].values["time"]:
            row = rows[max(before, after)]
            raise ScenarioError(
                f"{source}: line {row.line}: a second row of '{row.name}' at "
                f"{row.values['time']:g} s; keep one, or give two aircraft two names"
            )
    first = rows[order[0]]
    velocity = _velocity(first, places[order[0]], frame)
    if len(order) == 1 and velocity is None:
        raise ScenarioError(
            f"{source}: line {first.line}: '{first.name}' has one row and no velocity; "
            "give a second row, or columns of track, ground speed and vertical speed"
        )
    times = np.array([rows[n].values["time"] for n in order])
    return RecordedFlight(
        first.name, min(rows[n].line for n in numbers), times, places[order], velocity
    )


def _velocity(row: StateRow, place: Array, frame: LocalFrame | None) -> Point | None:
    """What the row says of it, in the frame."""
    values = row.values
    if {"trk", "gs"} <= values.keys():
        course, speed = math.radians(values["trk"]), values["gs"]
        if frame:
            course = frame.course_rad(float(place[0]), float(place[1]), values["trk"])
        north, east = speed * math.cos(course), speed * math.sin(course)
        return (north, east, -values.get("vs", 0.0) + 0.0)
    if {"vx", "vy"} <= values.keys():
        east, north = values["vx"], values["vy"]
        if frame:
            true_deg = math.degrees(math.atan2(east, north))
            course = frame.course_rad(float(place[0]), float(place[1]), true_deg)
            speed = math.hypot(east, north)
            north, east = speed * math.cos(course), speed * math.sin(course)
        return (north, east, -values.get("vz", 0.0) + 0.0)
    return None
