"""Shorthands for rules: `--loss 20%@60s+30s`, `--kill 1@40s`, `--clock-offset 2:500ms`.

Each kind of fault has its own; the presets come first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from fleet.faults.options import RuleTable, Shorthand, Variation
from fleet.faults.presets import PRESETS, Preset
from fleet.faults.registry import options

PRESET = "preset"


def shorthands() -> tuple[str, ...]:
    """All options, in the order of the rules that they make."""
    return (PRESET, *(option.option for _, option in options()))


def rules_of(given: Mapping[str, Sequence[str]], broadcast_s: float) -> list[RuleTable]:
    """`[[fault]]` tables for the texts given by shorthand; raises ValueError, naming the option.

    Presets go by the time between two broadcasts of a UAV. Of what varies others (`jitter` every
    `latency`, `burst` every `loss`) the last one counts.
    """
    found = options()
    texts = {option.option: list(given.get(option.option, ())) for _, option in found}
    varied: dict[str, tuple[str, Variation, Any]] = {}
    for kind, option in found:
        if isinstance(option, Variation) and texts[option.option]:
            if not texts[option.of] and not option.alone:
                raise ValueError(f"--{option.option}: {option.needs}")
            values = [_parsed(option.option, option.parse, t) for t in texts[option.option]]
            texts[option.of] = texts[option.of] or [option.alone]
            varied[option.of] = (kind, option, values[-1])
    out: list[RuleTable] = []
    for name in given.get(PRESET, ()):
        out += map(msgspec.to_builtins, _parsed(PRESET, _preset, name)(broadcast_s))
    for kind, option in found:
        if isinstance(option, Shorthand):
            for text in texts[option.option]:
                table = _parsed(option.option, option.make, text)
                out.append(_varied(kind, table, varied.get(option.option)))
    return out


def _varied(kind: str, table: RuleTable, by: tuple[str, Variation, Any] | None) -> RuleTable:
    """The rule that an option makes, as another one varies it."""
    if by is None:
        return {"kind": kind, **table}
    other, variation, value = by
    return {"kind": other, **variation.vary(table, value)}


def _preset(name: str) -> Preset:
    if name not in PRESETS:
        raise ValueError(f"'{name}' is no preset; write one of {', '.join(PRESETS)}")
    return PRESETS[name]


def _parsed(option: str, parse: Callable[[str], Any], text: str) -> Any:
    try:
        return parse(text)
    except ValueError as error:
        raise ValueError(f"--{option}: {error}") from error
