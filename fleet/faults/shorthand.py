"""Shorthands for rules: `--loss 20%@60s+30s`, `--kill 1@40s`, `--clock-offset 2:500ms`.

Each kind of fault has its own; the presets come first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from fleet.faults.options import OptionRule, RuleTable, Shorthand, Variation
from fleet.faults.presets import PRESETS, Preset
from fleet.faults.registry import options

PRESET = "preset"


def shorthands() -> tuple[str, ...]:
    """All options, in the order of the rules that they make."""
    return (PRESET, *(option.option for _, option in options()))


def from_now_on(given: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """What needs a window, as killing a process, begins at once where no time is given."""
    timed = {o.option for _, o in options() if isinstance(o, Shorthand) and o.timed}
    return {
        name: [f"{t}@0s" if name in timed and "@" not in t else t for t in texts]
        for name, texts in given.items()
    }


def rules_of(given: Mapping[str, Sequence[str]], broadcast_s: float) -> list[OptionRule]:
    """`[[fault]]` tables for the texts given by shorthand; raises ValueError, naming the option.

    Presets go by the time between two broadcasts of a UAV. Of what varies others (`jitter` every
    `latency`, `burst` every `loss`) the last one counts.
    """
    found = options()
    texts = {option.option: list(given.get(option.option, ())) for _, option in found}
    varied: dict[str, _Varied] = {}
    for kind, option in found:
        if isinstance(option, Variation) and texts[option.option]:
            if not texts[option.of] and not option.alone:
                raise ValueError(f"--{option.option}: {option.needs}")
            values = [_parsed(option.option, option.parse, t) for t in texts[option.option]]
            said = f"--{option.option} {texts[option.option][-1]}"
            varied[option.of] = _Varied(kind, option, values[-1], said, alone=not texts[option.of])
            texts[option.of] = texts[option.of] or [option.alone]
    out: list[OptionRule] = []
    for name in given.get(PRESET, ()):
        rules = _parsed(PRESET, _preset, name)(broadcast_s)
        out += [OptionRule(f"--{PRESET} {name}", msgspec.to_builtins(rule)) for rule in rules]
    for kind, option in found:
        if isinstance(option, Shorthand):
            for text in texts[option.option]:
                table = _parsed(option.option, option.make, text)
                said = f"--{option.option} {text}"
                by = varied.get(option.option)
                out.append(
                    by.rule(said, table) if by else OptionRule(said, {"kind": kind, **table})
                )
    return out


@dataclass(frozen=True)
class _Varied:
    """An option that varies another as it was given; `alone` if the other was not."""

    kind: str
    variation: Variation
    value: Any
    said: str
    alone: bool

    def rule(self, other: str, table: RuleTable) -> OptionRule:
        """The rule that the other option makes, varied."""
        varied = {"kind": self.kind, **self.variation.vary(table, self.value)}
        return OptionRule(self.said if self.alone else f"{other} {self.said}", varied)


def _preset(name: str) -> Preset:
    if name not in PRESETS:
        raise ValueError(f"'{name}' is no preset; write one of {', '.join(PRESETS)}")
    return PRESETS[name]


def _parsed(option: str, parse: Callable[[str], Any], text: str) -> Any:
    try:
        return parse(text)
    except ValueError as error:
        raise ValueError(f"--{option}: {error}") from error
