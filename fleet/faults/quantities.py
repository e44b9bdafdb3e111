"""Quantities as they are written on the command line, with their units: 300ms, 5km, 20%."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from fleet.faults.whom import WHO

NM_M = 1852.0
"""The nautical mile."""

_NUMBER = r"(-?)(\d+(?:\.\d*)?|\.\d+)"


def quantity(text: str, units: Mapping[str, float], say: str, *, signed: bool = False) -> float:
    """A number with one of these units, in SI; raises ValueError with what to say."""
    found = re.fullmatch(rf"{_NUMBER}\s*({'|'.join(map(re.escape, units))})", text.strip())
    value = float(found[1] + found[2]) * units[found[3]] if found else math.nan
    if not math.isfinite(value) or (value < 0.0 and not signed):
        raise ValueError(f"'{text}' is {say}")
    return value


_TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}


def moment_s(text: str) -> float:
    """A moment of simulated time, or how long from one to the next; raises ValueError.

    300ms, 0.3s, 2min, or plain seconds, in which simulated time is told everywhere.
    """
    return quantity(text, {**_TIMES_S, "": 1.0}, "no time; write 300ms, 0.3s or 2min")


def delay_s(text: str) -> float:
    """A time in a rule: 300ms, 0.3s, 2min; a plain number could be in ms. Raises ValueError."""
    return _with_unit(text, "no time; write 300ms, 0.3s or 2min")


def offset_s(text: str) -> float:
    """The same, but it may be negative; raises ValueError."""
    return _with_unit(text, "no offset; write 500ms or -500ms", signed=True)


def _with_unit(text: str, say: str, *, signed: bool = False) -> float:
    plain = re.fullmatch(_NUMBER, text.strip())
    if plain and float(plain[2]):
        raise ValueError(f"'{text}' has no unit; write {plain[0]}ms or {plain[0]}s")
    return 0.0 if plain else quantity(text, _TIMES_S, say, signed=signed)


def metres(text: str) -> float:
    """A length: 500m, 5km, 3NM; raises ValueError."""
    return quantity(text, {"m": 1.0, "km": 1e3, "NM": NM_M}, "no length; write 500m, 5km or 3NM")


def bits_per_s(text: str) -> float:
    """A rate in bits per second: 9600bit, 100kbit, 1Mbit; raises ValueError."""
    units = {"bit": 1.0, "kbit": 1e3, "Mbit": 1e6}
    return quantity(text, units, "no rate per second; write 9600bit, 100kbit or 1Mbit")


def fraction(text: str) -> float:
    """A probability: 20% or 0.2; raises ValueError."""
    say = "no probability; write 20% or 0.2"
    value = quantity(text, {"%": 0.01, "": 1.0}, say)
    if value > 1.0:
        raise ValueError(f"'{text}' is {say}")
    return value


def count(text: str) -> float:
    """A plain number; raises ValueError."""
    return quantity(text, {"": 1.0}, "no number; write 5")


def factor(text: str) -> int:
    """A whole number; raises ValueError."""
    say = "no factor; write 2 or a greater whole number"
    value = quantity(text, {"": 1.0}, say)
    if value % 1.0:
        raise ValueError(f"'{text}' is {say}")
    return int(value)


def who(text: str) -> str:
    """Whom a rule is for: uav, coordinator, 1-4,7; raises ValueError."""
    if not re.fullmatch(WHO, text):
        raise ValueError(f"'{text}' is nobody; write 2, 1-4,7, uav or coordinator")
    return text
