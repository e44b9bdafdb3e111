"""The text of a BlueSky scenario: `HH:MM:SS.hh>COMMAND arguments`, and what the arguments say.

As BlueSky 1.1 reads it (`stack/simstack.py`, `stack/argparser.py`, `tools/misc.py`): arguments are
parted by blanks, a comma or both; altitudes are in feet or `FL200`; speeds in knots of calibrated
airspeed, or a Mach number (below 1, or with `M`); headings true, in degrees.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from fleet.imports.atmosphere import speed_of_sound_mps, true_airspeed_mps
from fleet.imports.foreign_units import FEET_A_MINUTE_TO_MPS, FEET_TO_M, KNOTS_TO_MPS
from fleet.imports.imported import ForeignTraffic

LEAST_LENGTH = 10
"""BlueSky takes no shorter line for a command."""

_ARGUMENT = re.compile(r"\s*['\"]?((?<=['\"])[^'\"]*|(?<!['\"])[^\s,]*)['\"]?\s*,?\s*(.*)")
_TIME = re.compile(r"(\d+):(\d+):(\d+(?:\.\d*)?)")
_LATITUDE = re.compile(r"[+-]?[NS]?[+-]?[\d.'\"\u00b0+-]+(E[+-]?\d+)?")


@dataclass(frozen=True, slots=True)
class StackCommand:
    """One command: when, what, and its arguments as they stand there."""

    line: int
    time_s: float
    name: str
    arguments: tuple[str, ...]

    def argument(self, place: int) -> str:
        """One of them; empty where there are fewer, or nothing stands between two commas."""
        return self.arguments[place] if place < len(self.arguments) else ""


def stack_commands(lines: Iterable[str], traffic: ForeignTraffic) -> list[StackCommand]:
    """The commands in the order in which they are given; what is none gets a remark."""
    found: list[StackCommand] = []
    for number, line in _whole_lines(lines):
        stamp, arrow, rest = line.partition(">")
        time = _TIME.fullmatch(stamp.strip())
        if not arrow or not time:
            traffic.remark(number, line[:20], "not HH:MM:SS.hh>COMMAND; BlueSky leaves it aside")
            continue
        hours, minutes, seconds = time.groups()
        time_s = 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
        for text in rest.split(";"):
            words = tuple(arguments_of(text))
            if words:
                found.append(StackCommand(number, time_s, words[0].upper(), words[1:]))
    return sorted(found, key=lambda command: command.time_s)


def _whole_lines(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Lines without comments, those that go on in the next one put together."""
    before, begun = "", 0
    for number, text in enumerate(lines, 1):
        line = text.strip()
        if len(line) < LEAST_LENGTH or line.startswith("#"):
            continue
        line, begun = before + line, begun or number
        if line.endswith("\\"):
            before = f"{line[:-1].strip()} "
            continue
        yield begun, line.partition("#")[0].strip()
        before, begun = "", 0


def arguments_of(text: str) -> Iterator[str]:
    """Words parted by blanks, commas or both; nothing between two commas is an empty one."""
    rest = text.strip()
    while rest:
        found = _ARGUMENT.match(rest)
        assert found
        word, rest = found.groups()
        yield word


def is_latitude(text: str) -> bool:
    """Whether BlueSky would take it for one, and not for a name."""
    return bool(_LATITUDE.fullmatch(text.upper()))


def latitude_deg(text: str) -> float:
    """As in `52.3`, `N52`, `S52'14'13.5`; raises ValueError."""
    return _bounded(_sexagesimal(text.upper(), "N", "S"), 90.0, text)


def longitude_deg(text: str) -> float:
    """As in `4.7`, `E004`, `W4'30'`; raises ValueError."""
    degrees = _bounded(_sexagesimal(text.upper(), "E", "W"), 360.0, text)
    return math.remainder(degrees, 360.0)


def _sexagesimal(text: str, positive: str, negative: str) -> float:
    try:
        return float(text)
    except ValueError:
        pass
    plain = text.replace(positive, "").replace(negative, "-")
    sign = -1.0 if "-" in plain else 1.0
    parts = re.split("['\"\u00b0]", plain)
    return sign * sum(abs(float(p)) / 60.0**n for n, p in enumerate(parts) if p)


def altitude_m(text: str) -> float:
    """Of feet, or of a flight level as `FL200`; raises ValueError."""
    if text.upper().startswith("FL"):
        return 100.0 * int(text[2:]) * FEET_TO_M
    return _bounded(float(text), 1e6, text) * FEET_TO_M


def airspeed_mps(text: str, altitude: float) -> float:
    """True airspeed at an altitude in m, of knots or a Mach number; raises ValueError."""
    told = text.upper()
    number = float(told.replace("M0.", ".").replace("M", ".").replace("..", "."))
    if "M" in told or 0.1 < number < 1.0:
        return _bounded(number, 10.0, text) * speed_of_sound_mps(altitude)
    speed = _bounded(number, 2000.0, text) * KNOTS_TO_MPS
    return math.copysign(true_airspeed_mps(abs(speed), altitude), speed)


def heading_deg(text: str) -> float:
    """A true heading; raises ValueError, also for a magnetic one (`M090`)."""
    if "M" in text.upper():
        raise ValueError(f"'{text}' is a magnetic heading; give a true one")
    return _bounded(float(text.upper().replace("T", "")), 1e4, text)


def climb_mps(text: str) -> float:
    """Of feet a minute; raises ValueError."""
    return _bounded(float(text), 1e6, text) * FEET_A_MINUTE_TO_MPS


def duration_s(text: str) -> float:
    """Of seconds, `MM:SS` or `HH:MM:SS`; raises ValueError."""
    parts = [float(part) if part else 0.0 for part in text.split(":")]
    return _bounded(sum(part * 60.0**n for n, part in enumerate(reversed(parts))), 1e6, text)


def number_of(text: str) -> float:
    """A finite number; raises ValueError."""
    return _bounded(float(text), 1e9, text)


def _bounded(value: float, bound: float, text: str) -> float:
    if not abs(value) <= bound:  # nor NaN
        raise ValueError(f"'{text}' is out of range")
    return value
