"""A file of another program, read by the format that its name says, as a scenario."""

from __future__ import annotations

import re
from collections.abc import Sequence
from os import PathLike
from typing import TypeVar

import msgspec

from fleet.arguments import path_of, require, require_each
from fleet.config.explaining import plainly
from fleet.config.scenario import Origin, Zone
from fleet.config.text_files import file_text
from fleet.errors import ArgumentError, ScenarioError
from fleet.imports.bluesky import read_bluesky
from fleet.imports.csv_flights import read_csv_flights
from fleet.imports.daidalus import read_daidalus
from fleet.imports.imported import ForeignSettings, ForeignTraffic
from fleet.imports.recorded_flight import Tolerance3D
from fleet.imports.scenario_making import ImportedTraffic, imported_traffic

_Table = TypeVar("_Table")
MAX_FOREIGN_BYTES = 256 << 20
SUFFIXES = {".scn": "BlueSky", ".daa": "DAIDALUS", ".xyz": "DAIDALUS", ".csv": "CSV"}


def import_traffic(
    path: str | PathLike[str],
    *,
    origin: Origin | tuple[float, float, float] | None = None,
    zone: Zone | tuple[float, float] | None = None,
    tolerance_m: tuple[float, float] | None = None,
    only: Sequence[str] = (),
    duration_s: float | None = None,
) -> ImportedTraffic:
    """The traffic of a BlueSky `.scn`, DAIDALUS `.daa` or CSV file as a scenario, with remarks.

    `origin` (latitude and longitude in degrees, altitude in m) is where NED begins, by default in
    the middle of the traffic at altitude 0. `zone` is radius and half height in m, by default what
    the program means by its own. Recorded flights become waypoints from which no record is further
    than `tolerance_m`, across and up. `only` names the aircraft to take, by default all.

    Raises:
        ScenarioError: the file cannot be read, is none of these, or nobody in it can fly.
        MissingExtraError: pyproj is not installed; ArgumentError: a wrong argument.

    """
    file = path_of(path, "import_traffic", "the path of a file")
    require_each(only, str, "only", "names of aircraft, as ('AC1', 'AC2')")
    source, program = file.name, SUFFIXES.get(file.suffix.lower())
    if program is None:
        raise ScenarioError(f"{file}: its name ends in none of {', '.join(SUFFIXES)}; rename it")
    try:
        text = file_text(file, str(file), MAX_FOREIGN_BYTES, "an import", "text file")
    except OSError as error:
        raise ScenarioError(f"{file}: cannot be read: {error.strerror}") from error
    except ScenarioError:
        raise
    except ValueError as error:  # as of a name with a null character
        raise ScenarioError(f"{str(file)!r}: cannot be read: {error}") from error
    if not text.strip():
        raise ScenarioError(f"{file}: empty")
    if "\0" in text:
        raise ScenarioError(f"{file}: not a text file, it has null characters")
    middle = _origin(origin)
    tolerance = _tolerance(tolerance_m, zone)
    lines = text.split("\n")
    if program == "BlueSky":
        traffic = read_bluesky(lines, middle)
    elif program == "DAIDALUS":
        traffic = read_daidalus(lines, source, middle, tolerance)
    else:
        traffic = read_csv_flights(lines, source, middle, tolerance)
    _choose(traffic, only, source)
    if zone is not None:
        s = traffic.settings
        traffic.settings = ForeignSettings(_zone(zone), s.horizon_s, s.max_bank_deg)
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem)[:64] or "imported"
    return imported_traffic(traffic, source, name, duration_s)


def _choose(traffic: ForeignTraffic, only: Sequence[str], source: str) -> None:
    """Keep those that are named."""
    if not only:
        return
    named = {uav.name: uav for uav in traffic.uavs}
    for name in only:
        if name not in named:
            raise ScenarioError(f"{source}: no aircraft '{name}'; there are {_some([*named])}")
    traffic.uavs = [named[name] for name in dict.fromkeys(only)]


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:10]) + (", ..." if len(names) > 10 else "")


def _origin(given: object) -> Origin | None:
    if given is None or isinstance(given, Origin):
        return given
    what = "latitude, longitude and altitude, as (47.4, 8.5, 488.0)"
    return _converted(
        given, Origin, ("latitude_deg", "longitude_deg", "altitude_m"), "origin", what
    )


def _zone(given: object) -> Zone:
    if isinstance(given, Zone):
        return given
    what = "radius and half height in m, as (200.0, 25.0)"
    return _converted(given, Zone, ("radius_m", "half_height_m"), "zone", what)


def _tolerance(given: object, zone: object) -> Tolerance3D | None:
    if given is None:
        return None if zone is None else Tolerance3D.of(_zone(zone))
    what = "distances across and up in m, as (20.0, 5.0)"
    return _converted(given, Tolerance3D, ("across_m", "up_m"), "tolerance_m", what)


def _converted(
    given: object, kind: type[_Table], keys: Sequence[str], where: str, what: str
) -> _Table:
    require(given, (tuple, list), where, what)
    assert isinstance(given, tuple | list)
    if len(given) != len(keys):
        require(given, (), where, what)
    try:
        return msgspec.convert(dict(zip(keys, given, strict=True)), kind)
    except msgspec.ValidationError as error:
        raise ArgumentError(f"{where}: {plainly(str(error), {})}") from error
