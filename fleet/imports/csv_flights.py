"""Recorded flights in CSV: a line of column names with units, a row for each aircraft and time."""

from __future__ import annotations

import csv
from collections.abc import Sequence

from fleet.config.scenario import Origin, Zone
from fleet.errors import ScenarioError
from fleet.imports.foreign_units import FEET_TO_M, KNOTS_TO_MPS
from fleet.imports.imported import ForeignSettings, ForeignTraffic
from fleet.imports.recorded_flight import Tolerance3D
from fleet.imports.state_rows import StateRow, number_in, take_rows

RECORDED = ForeignSettings(Zone(), 40.0, 30.0)
"""A file of recorded flights says nothing of these; they are the defaults of scenarios."""

CSV_COLUMNS: dict[str, tuple[str, float]] = {
    "id": ("name", 1.0),
    "time_s": ("time", 1.0),
    "time": ("time", 1.0),
    "lat_deg": ("lat", 1.0),
    "lat": ("lat", 1.0),
    "latitude": ("lat", 1.0),
    "lon_deg": ("lon", 1.0),
    "lon": ("lon", 1.0),
    "longitude": ("lon", 1.0),
    "alt_m": ("alt", 1.0),
    "alt_ft": ("alt", FEET_TO_M),
    "speed_mps": ("gs", 1.0),
    "speed_kt": ("gs", KNOTS_TO_MPS),
    "heading_deg": ("trk", 1.0),
    "climb_mps": ("vs", 1.0),
}
"""A column of the file, and which one it is; altitude and speed need their unit in the name."""

NEEDED = {"name": "id", "time": "time_s", "lat": "lat_deg", "lon": "lon_deg", "alt": "alt_m"}


def read_csv_flights(
    lines: Sequence[str], source: str, origin: Origin | None, tolerance: Tolerance3D | None
) -> ForeignTraffic:
    """The traffic of a file of recorded flights; raises ScenarioError for what is none."""
    traffic = ForeignTraffic("CSV", RECORDED, origin or Origin())
    take_rows(_rows(lines, source, traffic), source, traffic, origin, tolerance)
    return traffic


def _rows(lines: Sequence[str], source: str, traffic: ForeignTraffic) -> list[StateRow]:
    first = next((line for line in lines if line.strip()), "")
    delimiter = ";" if first.count(";") > first.count(",") else ","
    reader = csv.reader(lines, delimiter=delimiter)
    header: list[tuple[str, float]] | None = None
    rows: list[StateRow] = []
    try:
        for words in reader:
            if not any(word.strip() for word in words) or words[0].startswith("#"):
                continue
            where = f"{source}: line {reader.line_num}"
            if header is None:
                header = _header(words, where, traffic, reader.line_num)
            else:
                rows.append(_row(header, words, where, reader.line_num))
    except csv.Error as error:
        raise ScenarioError(f"{source}: line {reader.line_num}: no CSV: {error}") from error
    if header is None:
        raise ScenarioError(f"{source}: no line of column names; begin with {_wanted()}")
    return rows


def _wanted() -> str:
    return ",".join(NEEDED.values())


def _header(
    words: Sequence[str], where: str, traffic: ForeignTraffic, number: int
) -> list[tuple[str, float]]:
    names = [word.strip().lower() for word in words]
    header = [CSV_COLUMNS.get(name, ("", 1.0)) for name in names]
    found = [name for name, _ in header if name]
    for column, name in NEEDED.items():
        if column not in found:
            near = ""
            if column == "alt" and {"alt", "altitude"} & set(names):
                near = " ('alt' has no unit: write alt_m or alt_ft)"
            raise ScenarioError(f"{where}: no column {name}{near}; the columns are {_wanted()}")
    twice = sorted({name for name in found if found.count(name) > 1})
    if twice:
        raise ScenarioError(f"{where}: two columns for {NEEDED.get(twice[0], twice[0])}; keep one")
    aside = [name for name, (column, _) in zip(names, header, strict=True) if not column and name]
    if aside:
        traffic.remark(number, ", ".join(aside), "columns that are not taken over")
    return header


def _row(
    header: Sequence[tuple[str, float]], words: Sequence[str], where: str, number: int
) -> StateRow:
    if len(words) != len(header):
        raise ScenarioError(f"{where}: {len(words)} values for {len(header)} columns; give all")
    name, values = "", dict[str, float]()
    for (column, factor), word in zip(header, words, strict=True):
        text = word.strip()
        if column == "name":
            name = text
        elif column in ("gs", "trk", "vs") and not text:
            continue
        elif column:
            values[column] = number_in(text, factor, column, where)
    if not name:
        raise ScenarioError(f"{where}: id: no value; name the aircraft")
    return StateRow(number, name, values)
