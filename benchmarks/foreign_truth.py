"""Where the aircraft of a foreign file fly, reckoned on the ellipsoid straight from the file.

Nothing of `fleet.imports` is used: this is what imports are held against. BlueSky's aircraft are
stepped along geodesics; records are interpolated. Positions are Earth-centred, Earth-fixed.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np
import pyproj

from fleet.model.types import Array

FOOT, KNOT, MILE = 0.3048, 1852.0 / 3600.0, 1852.0
GEOD = pyproj.Geod(ellps="WGS84")
TO_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
STEP_S = 0.5
STEEP = 5.0
"""At a relative speed under this, in m/s, the time of the closest point is not sharp."""


@dataclass(frozen=True)
class Nearest:
    """The closest point of approach of two paths: when, how far apart, and whether it is sharp."""

    time_s: float
    distance_m: float
    sharp: bool


@dataclass
class Craft:
    """An aircraft of BlueSky as it is stepped."""

    latitude: float
    longitude: float
    altitude: float
    track: float
    speed: float
    target: float
    rate: float = 1500.0 * FOOT / 60.0
    route: list[tuple[float, float, float | None]] = field(default_factory=list)

    def step(self) -> None:
        """Fly on for a step."""
        left = self.speed * STEP_S
        while self.route:
            latitude, longitude, altitude = self.route[0]
            if altitude is not None:
                self.target = altitude
            there = GEOD.inv(self.longitude, self.latitude, longitude, latitude)
            self.track = there[0]
            if there[2] > left:
                break
            self.latitude, self.longitude = latitude, longitude
            left -= there[2]
            self.route.pop(0)
            if not self.route:
                self.track = (there[1] + 180.0) % 360.0
        moved = GEOD.fwd(self.longitude, self.latitude, self.track, left)
        self.longitude, self.latitude = moved[0], moved[1]
        if left > 0.0 and not self.route:
            self.track = (moved[2] + 180.0) % 360.0  # on along the geodesic
        step = self.rate * STEP_S
        self.altitude += max(-step, min(step, self.target - self.altitude))


def true_airspeed(calibrated: float, altitude: float) -> float:
    """By pressure and density, as BlueSky writes it."""
    temperature = max(288.15 - 0.0065 * altitude, 216.65)
    pressure = 101325.0 * (temperature / 288.15) ** 5.255876
    if altitude > 11000.0:
        pressure *= math.exp(-9.80665 * (altitude - 11000.0) / (287.05287 * 216.65))
    density = pressure / (287.05287 * temperature)
    impact = 101325.0 * ((1.0 + 1.225 * calibrated**2 / (7.0 * 101325.0)) ** 3.5 - 1.0)
    return math.sqrt(7.0 * pressure / density * ((1.0 + impact / pressure) ** (2.0 / 7.0) - 1.0))


def bluesky_paths(file: Path, until_s: float) -> dict[str, Array]:
    """ECEF at every step from the first creation on, by name; NaN before the own one."""
    commands = sorted(_commands(file), key=lambda found: found[0])
    crafts, paths = dict[str, Craft](), dict[str, list[tuple[float, ...]]]()
    begin = min(time for time, words in commands if words[0] == "CRE")
    now = begin
    count = int(until_s / STEP_S) + 1
    for n in range(count):
        now = begin + n * STEP_S
        while commands and commands[0][0] <= now + 1e-9:
            _, words = commands.pop(0)
            _obey(words, crafts)
        for name, craft in crafts.items():
            path = paths.setdefault(name, [(math.nan, math.nan, math.nan)] * n)
            path.append((craft.longitude, craft.latitude, craft.altitude))
            craft.step()
    return {name: _ecef(np.array(path)) for name, path in paths.items()}


def _commands(file: Path) -> Iterator[tuple[float, list[str]]]:
    for line in file.read_text(encoding="utf-8").splitlines():
        found = re.match(r"\s*(\d+):(\d+):([\d.]+)>\s*(.*)", line.partition("#")[0])
        if found and len(line.strip()) >= 10:
            hours, minutes, seconds, rest = found.groups()
            words = [w for w in re.split(r"[\s,]+", rest.strip().upper()) if w]
            yield 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds), words


def _feet(text: str) -> float:
    return FOOT * (100.0 * float(text[2:]) if text.startswith("FL") else float(text))


def _obey(words: list[str], crafts: dict[str, Craft]) -> None:
    name = words[1] if len(words) > 1 else ""
    craft = crafts.get(name)
    match words[0]:
        case "CRE" if craft is None:
            latitude, longitude, track = map(float, words[3:6])
            altitude = _feet(words[6])
            speed = true_airspeed(float(words[7]) * KNOT, altitude)
            crafts[name] = Craft(latitude, longitude, altitude, track, speed, altitude)
        case "HDG" if craft:
            craft.track, craft.route = float(words[2]), []
        case "VS" if craft:
            craft.rate = abs(float(words[2])) * FOOT / 60.0
        case "ALT" if craft:
            craft.target = _feet(words[2])
        case "ADDWPT" if craft:
            height = _feet(words[4]) if len(words) > 4 else None
            craft.rate = 3000.0 * FOOT / (10.0 * MILE) * craft.speed
            point = (float(words[2]), float(words[3]), height)
            craft.route.insert(len(craft.route) - _has_goal(craft), point)
        case "DEST" if craft and re.fullmatch(r"[\d.+-]+", words[2]):
            craft.route.append((float(words[2]), float(words[3]), None))


def _has_goal(craft: Craft) -> int:
    return int(bool(craft.route) and craft.route[-1][2] is None)


def recorded_paths(file: Path, until_s: float) -> dict[str, Array]:
    """ECEF (or the file's own axes) at every step from its first time on, by name."""
    rows: dict[str, list[tuple[float, float, float, float]]] = {}
    euclidean = False
    for name, time, places, flat in _states(file):
        rows.setdefault(name, []).append((time, *places))
        euclidean = flat
    begin = min(row[0][0] for row in rows.values())
    times = begin + np.arange(int(until_s / STEP_S) + 1) * STEP_S
    out = {}
    for name, states in rows.items():
        table = np.array(states)
        points = table[:, 1:] if euclidean else _ecef(table[:, [2, 1, 3]])
        path = np.column_stack([np.interp(times, table[:, 0], x) for x in points.T])
        path[(times < table[0, 0]) | (times > table[-1, 0])] = math.nan
        out[name] = path
    return out


def _states(file: Path) -> Iterator[tuple[str, float, tuple[float, float, float], bool]]:
    """Name, time, latitude, longitude and altitude (or east, north and up), and which of both."""
    lines = file.read_text(encoding="utf-8").splitlines()
    if file.suffix == ".csv":
        for row in csv.DictReader(lines):
            place = (float(row["lat_deg"]), float(row["lon_deg"]), float(row["alt_m"]))
            yield row["id"], float(row["time_s"]), place, False
        return
    table = [re.split(r"[,\s]+", line.strip()) for line in lines if line and line[0] != "#"]
    header, units = table[0], table[1]
    flat = "sx" in header
    across, up = ("sx", "sy"), "sz"
    if not flat:
        across, up = ("lat", "lon"), "alt"
    factor = {"[deg]": 1.0, "[nmi]": MILE, "[ft]": FOOT, "[s]": 1.0}
    at = {name: (k, factor.get(units[k], math.nan)) for k, name in enumerate(header)}
    for words in table[2:]:
        value = [float(words[at[c][0]]) * at[c][1] for c in (*across, up, "time")]
        yield words[0], value[3], (value[0], value[1], value[2]), flat


def _ecef(geodetic: Array) -> Array:
    """Of rows longitude, latitude, altitude."""
    return np.column_stack(TO_ECEF.transform(*geodetic.T))


def nearest(one: Array, two: Array) -> Nearest | None:
    """Of two paths with a place a step; between them straight on. None if they share no time."""
    apart = two - one
    known = ~np.isnan(apart[:, 0])
    if known.sum() < 2:
        return None
    first = int(known.argmax())
    apart = apart[known]
    start, step = apart[:-1], np.diff(apart, axis=0)
    squared = np.maximum((step * step).sum(axis=1), 1e-12)
    share = np.clip(-(start * step).sum(axis=1) / squared, 0.0, 1.0)
    least = np.linalg.norm(start + share[:, None] * step, axis=1)
    n = int(least.argmin())
    time = (first + n + float(share[n])) * STEP_S
    inside = 0.0 < time - first * STEP_S < (len(apart) - 1) * STEP_S - 1e-6
    return Nearest(time, float(least[n]), inside and float(np.sqrt(squared[n])) > STEEP * STEP_S)


def all_nearest(paths: dict[str, Array]) -> dict[tuple[str, str], Nearest]:
    """Of all pairs, by name."""
    found = {(a, b): nearest(paths[a], paths[b]) for a, b in combinations(paths, 2)}
    return {pair: near for pair, near in found.items() if near is not None}
