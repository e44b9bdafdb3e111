"""Shorthands for rules: `--loss 20%@60s+30s`, `--kill 1@40s`, `--clock-offset 2:500ms`.

All have the form [WHO:]WHAT[@START[+LENGTH]]: a window starts at START and ends LENGTH later or
never; without it the rule is always in force.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from fleet.faults.presets import NM_M, PRESETS
from fleet.faults.rules import WHO

RuleTable = dict[str, Any]
"""A `[[fault]]` table."""

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


def window(text: str) -> tuple[str, RuleTable]:
    """What stands before `@START+LENGTH`, and the keys of the window; raises ValueError."""
    what, at, when = text.partition("@")
    if not at:
        return what, {}
    start, plus, length = when.partition("+")
    start_s = delay_s(start) if start or not plus else 0.0
    if not plus:
        return what, {"start_s": start_s}
    length_s = delay_s(length)
    if length_s == 0.0:
        raise ValueError(f"'{text}' lasts no time; write a length after the +")
    return what, {"start_s": start_s, "end_s": start_s + length_s}


def who(text: str) -> str:
    """Whom a rule is for: uav, coordinator, 1-4,7; raises ValueError."""
    if not re.fullmatch(WHO, text):
        raise ValueError(f"'{text}' is nobody; write 2, 1-4,7, uav or coordinator")
    return text


def preset(name: str) -> Any:
    """A preset by its name; raises ValueError."""
    if name not in PRESETS:
        raise ValueError(f"'{name}' is no preset; write one of {', '.join(PRESETS)}")
    return PRESETS[name]


Make = Callable[[str], RuleTable]
"""A table from the text of an option."""


def _of_links(kind: str, key: str, parse: Callable[[str], Any], **more: object) -> Make:
    """WHAT@WINDOW, for a rule about links."""

    def make(text: str) -> RuleTable:
        what, at = window(text)
        return {"kind": kind, key: parse(what), **more, **at}

    return make


def _of_nodes(kind: str, *, timed: bool = False, **more: object) -> Make:
    """WHO@WINDOW, for a rule about participants; `timed`: not without a window."""

    def make(text: str) -> RuleTable:
        node, at = window(text)
        if timed and not at:
            raise ValueError(f"'{text}' does not say when; write {text}@40s or {text}@40s+20s")
        return {"kind": kind, "node": who(node), **more, **at}

    return make


def _of_nodes_by(
    kind: str, key: str, parse: Callable[[str], Any], example: str, everybody: str = ""
) -> Make:
    """WHO:WHAT@WINDOW, for a rule about participants; WHO can be left out if there is a default."""

    def make(text: str) -> RuleTable:
        both, at = window(text)
        node, colon, what = both.rpartition(":")
        if not colon and not everybody:
            raise ValueError(f"'{text}' does not say for whom; write {example}")
        return {"kind": kind, "node": who(node if colon else everybody), key: parse(what), **at}

    return make


def _factor(text: str) -> int:
    say = "no factor; write 2 or a greater whole number"
    value = quantity(text, {"": 1.0}, say)
    if value % 1.0:
        raise ValueError(f"'{text}' is {say}")
    return int(value)


_MAKES: dict[str, Make] = {
    "range": _of_links("range", "max_m", metres),
    "partition": _of_links("partition", "groups", str),
    "duplicate": _of_links("duplicate", "probability", fraction),
    "replay": _of_links("replay", "probability", fraction),
    "reorder": _of_links("reorder", "probability", fraction),
    "corrupt": _of_links("corrupt", "probability", fraction),
    "rate": _of_links("rate", "bits_per_s", bits_per_s),
    "kill": _of_nodes("kill", timed=True),
    "pause": _of_nodes("pause", timed=True),
    "slow": _of_nodes_by("slow", "factor", _factor, "2:4@50s+10s"),
    "gps-noise": _of_nodes_by("navigation", "noise_m", metres, "2:10m", everybody="uav"),
    "gps-freeze": _of_nodes("navigation", freeze=True),
    "gps-dropout": _of_nodes("navigation", dropout=1.0),
    "clock-offset": _of_nodes_by("clock", "offset_s", offset_s, "2:500ms"),
}

SHORTHANDS = ("preset", "latency", "jitter", "loss", "burst", *_MAKES)
"""All shorthands, in the order of the rules that they make."""


def rules_of(given: Mapping[str, Sequence[str]], broadcast_s: float) -> list[RuleTable]:
    """`[[fault]]` tables for the texts given by shorthand; raises ValueError, naming the option.

    Presets go by the time between two broadcasts of a UAV. The last `jitter` is that of every
    `latency`, the last `burst` that of every `loss`.
    """
    makes = dict(_MAKES)
    texts = {name: list(given.get(name, ())) for name in SHORTHANDS}
    makes["latency"] = _of_links("latency", "base_s", delay_s)
    makes["loss"] = _of_links("loss", "probability", fraction)
    for text in texts.pop("jitter"):
        jitter_s = _parsed("jitter", delay_s, text)
        makes["latency"] = _of_links("latency", "base_s", delay_s, jitter_s=jitter_s)
        texts["latency"] = texts["latency"] or ["0s"]
    for text in texts.pop("burst"):
        if not texts["loss"]:
            raise ValueError("--burst: needs --loss, the mean loss that its bursts make up")
        mean_ticks = _parsed("burst", count, text)
        makes["loss"] = _of_links("burst", "loss", fraction, mean_ticks=mean_ticks)
    out: list[RuleTable] = []
    for name in texts.pop("preset"):
        out += map(msgspec.to_builtins, _parsed("preset", preset, name)(broadcast_s))
    for name, found in texts.items():
        out += [_parsed(name, makes[name], text) for text in found]
    return out


def _parsed(option: str, parse: Callable[[str], Any], text: str) -> Any:
    try:
        return parse(text)
    except ValueError as error:
        raise ValueError(f"--{option}: {error}") from error
