"""DAIDALUS encounters (`.daa`): states of aircraft over time, in columns with a line of units.

As DAIDALUS reads it (`SequenceReader`): words parted by commas, semicolons, blanks or tabs; `#`
begins a comment; lines `key = value` are parameters; then a line of column names, a line of units
(`[deg]`, `[ft]`, ...), and a row for each aircraft and time. Positions are lat, lon, alt or sx
(east), sy (north), sz; velocities trk, gs, vs or vx (east), vy (north), vz.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from fleet.config.scenario import Origin, Zone
from fleet.errors import ScenarioError
from fleet.imports.foreign_units import (
    ANGLES,
    DURATIONS,
    FEET_TO_M,
    LENGTHS,
    NO_UNITS,
    SPEEDS,
)
from fleet.imports.imported import ForeignSettings, ForeignTraffic
from fleet.imports.recorded_flight import Tolerance3D
from fleet.imports.state_rows import StateRow, number_in, take_rows

DAIDALUS = ForeignSettings(Zone(2000.0 * FEET_TO_M, 225.0 * FEET_TO_M), 120.0, 30.0)
"""Well clear of RTCA DO-365, 4,000 ft and 450 ft between two aircraft, without its times."""

DAA_COLUMNS: dict[str, tuple[tuple[str, ...], dict[str, float], str]] = {
    "name": (("name", "aircraft", "id"), {}, ""),
    "lat": (("lat", "latitude"), ANGLES, "deg"),
    "lon": (("lon", "long", "longitude"), ANGLES, "deg"),
    "alt": (("alt", "altitude"), LENGTHS, "ft"),
    "sx": (("sx",), LENGTHS, "nmi"),
    "sy": (("sy",), LENGTHS, "nmi"),
    "sz": (("sz",), LENGTHS, "ft"),
    "trk": (("trk", "track"), ANGLES, "deg"),
    "gs": (("gs", "groundspeed", "groundspd"), SPEEDS, "knot"),
    "vs": (("vs", "verticalspeed", "hdot"), SPEEDS, "fpm"),
    "vx": (("vx",), SPEEDS, "knot"),
    "vy": (("vy",), SPEEDS, "knot"),
    "vz": (("vz",), SPEEDS, "fpm"),
    "time": (("time", "tm", "st"), DURATIONS, "s"),
}
"""A column's names, the units that it may have, and that which it has where none is said."""

AIR = {"heading", "airspeed"}
_PARTS = re.compile(r"[,;\s]+")
_PARAMETER = re.compile(r"\s*[A-Za-z_][\w.]*\s+=\s+\S")


def read_daidalus(
    lines: Sequence[str], source: str, origin: Origin | None, tolerance: Tolerance3D | None
) -> ForeignTraffic:
    """The traffic of an encounter file; raises ScenarioError for what is none."""
    traffic = ForeignTraffic("DAIDALUS", DAIDALUS, origin or Origin())
    take_rows(_rows(lines, source, traffic), source, traffic, origin, tolerance)
    return traffic


def _rows(lines: Sequence[str], source: str, traffic: ForeignTraffic) -> list[StateRow]:
    header: list[str] = []
    factors: list[float] | None = None
    rows: list[StateRow] = []
    parameters = 0
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        if not header and _PARAMETER.match(text):
            parameters += 1
            continue
        words = _PARTS.split(text.strip(" \t,;"))
        where = f"{source}: line {number}"
        if not header:
            header = _header(words, where, traffic, number)
        elif factors is None and _is_units(words):
            factors = _factors(header, words, where)
        else:
            if factors is None:
                factors = _default_factors(header, number, traffic)
            rows.append(_row(header, factors, words, where, number, rows))
    if not header:
        raise ScenarioError(f"{source}: no line of column names; is it a file of DAIDALUS?")
    if parameters:
        traffic.remark(0, f"{parameters} parameters", "settings of DAIDALUS, not taken over")
    return rows


def _header(words: list[str], where: str, traffic: ForeignTraffic, number: int) -> list[str]:
    """Our names of the columns, empty for those that are not taken over."""
    known = {alias: name for name, (names, _, _) in DAA_COLUMNS.items() for alias in names}
    header = [known.get(word.lower(), "") for word in words]
    found = set(header)
    for wanted, instead in (("name", ""), ("lat", "sx"), ("lon", "sy"), ("alt", "sz")):
        if not {wanted, instead} & found - {""}:
            or_ = f" or {instead}" if instead else ""
            raise ScenarioError(f"{where}: no column {wanted}{or_}; it names them before all rows")
    aside = [word for word, name in zip(words, header, strict=True) if not name]
    if AIR & {word.lower() for word in aside}:
        why = "of the air; aircraft fly over ground as they are on record, and there is no wind"
        traffic.remark(number, ", ".join(sorted(AIR)), why)
    rest = [word for word in aside if word.lower() not in AIR]
    if rest:
        traffic.remark(number, ", ".join(rest), "columns that are not taken over")
    return header


def _is_units(words: Sequence[str]) -> bool:
    """Whether a line is one of units: half of it at least are such, as DAIDALUS has it."""
    known = {*LENGTHS, *SPEEDS, *ANGLES, *DURATIONS, *NO_UNITS}
    return sum(_bare(word) in known for word in words) * 2 >= len(words)


def _bare(word: str) -> str:
    return word.strip().removeprefix("[").removesuffix("]").lower()


def _factors(header: Sequence[str], words: Sequence[str], where: str) -> list[float]:
    if len(words) != len(header):
        raise ScenarioError(f"{where}: {len(words)} units for {len(header)} columns; give each one")
    return [_factor(name, word, where) for name, word in zip(header, words, strict=True)]


def _factor(name: str, word: str, where: str) -> float:
    units = DAA_COLUMNS[name][1] if name else {}
    if not units:
        return 1.0
    unit = _bare(word)
    if unit not in units:
        what = "no unit" if unit in NO_UNITS else f"'{word}' is no unit of it"
        raise ScenarioError(f"{where}: {name}: {what}; there are {', '.join(units)}")
    return units[unit]


def _default_factors(header: Sequence[str], number: int, traffic: ForeignTraffic) -> list[float]:
    told = {name: DAA_COLUMNS[name][2] for name in header if name and name != "name"}
    units = ", ".join(f"{name} [{unit}]" for name, unit in told.items())
    traffic.remark(number, "units", f"no line of them; taken as DAIDALUS does: {units}")
    return [DAA_COLUMNS[name][1][told[name]] if name in told else 1.0 for name in header]


def _row(
    header: Sequence[str],
    factors: Sequence[float],
    words: Sequence[str],
    where: str,
    number: int,
    before: Sequence[StateRow],
) -> StateRow:
    if len(words) < len(header):
        raise ScenarioError(f"{where}: {len(words)} values for {len(header)} columns; give all")
    name, values = "", {"time": 0.0}
    for column, factor, word in zip(header, factors, words, strict=False):
        if column == "name":
            name = before[-1].name if word == '"' and before else word
        elif column:
            values[column] = number_in(word, factor, column, where)
    return StateRow(number, name, values)
