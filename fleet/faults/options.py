"""What the command line has for a kind of rule: an option, and how its text is read.

All have the form [WHO:]WHAT[@START[+LENGTH]]: a window starts at START and ends LENGTH later or
never; without it the rule is always in force.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from fleet.faults.quantities import delay_s, who

RuleTable = dict[str, Any]
"""The keys of a `[[fault]]` table."""

Make = Callable[[str], RuleTable]
"""The keys of a rule, but for its kind, from the text of an option; raises ValueError."""


class OptionRule(RuleTable):
    """The keys of a rule that an option stands for, and the option as it was given: `--loss 5%`."""

    said: str

    def __init__(self, said: str, table: RuleTable) -> None:
        super().__init__(table)
        self.said = said


def by_option(text: str, first: int, tables: Sequence[RuleTable]) -> str:
    """A text about `fault[N]`, by the option if one stands for that rule; a key in brackets.

    The rules of `tables` are those of a plan from number `first` on.
    """
    found = re.match(r"fault\[(\d+)\](?:\.(\w+)[^: ]*| \(\w+\))?", text)
    place = int(found[1]) - first if found else -1
    table = tables[place] if 0 <= place < len(tables) else {}
    if not found or not isinstance(table, OptionRule):
        return text
    return f"{table.said}{f' ({found[2]})' if found[2] else ''}{text[found.end() :]}"


@dataclass(frozen=True, kw_only=True)
class Shorthand:
    """An option that stands for a rule of the kind that has it.

    `metavar` and `help` are for `--help`, `example` and `note` for the documents. `timed`: it needs
    a window; where faults are changed while a run is on, it begins at once without one.
    """

    option: str
    metavar: str
    help: str
    example: str
    make: Make
    note: str = ""
    timed: bool = False


@dataclass(frozen=True, kw_only=True)
class Variation:
    """An option that changes all rules that another option, `of`, makes; the last given counts.

    `parse` reads it, and `vary` makes the keys of a rule of the kind that has it. Where the other
    is not given, it is taken to be as `alone`; if that is empty, `needs` says why it cannot be.
    """

    option: str
    metavar: str
    help: str
    example: str
    of: str
    parse: Callable[[str], Any]
    vary: Callable[[RuleTable, Any], RuleTable]
    alone: str = ""
    needs: str = ""
    note: str = ""


def what(key: str, parse: Callable[[str], Any], **more: object) -> Make:
    """WHAT@WINDOW, for a rule about links."""

    def make(text: str) -> RuleTable:
        value, at = window(text)
        return {key: parse(value), **more, **at}

    return make


def whom(*, timed: bool = False, **more: object) -> Make:
    """WHO@WINDOW, for a rule about participants; `timed`: not without a window."""

    def make(text: str) -> RuleTable:
        node, at = window(text)
        if timed and not at:
            raise ValueError(f"'{text}' does not say when; write {text}@40s or {text}@40s+20s")
        return {"node": who(node), **more, **at}

    return make


def whom_what(key: str, parse: Callable[[str], Any], example: str, everybody: str = "") -> Make:
    """WHO:WHAT@WINDOW, for a rule about participants; WHO can be left out if there is a default."""

    def make(text: str) -> RuleTable:
        both, at = window(text)
        node, colon, value = both.rpartition(":")
        if not colon and not everybody:
            raise ValueError(f"'{text}' does not say for whom; write {example}")
        return {"node": who(node if colon else everybody), key: parse(value), **at}

    return make


def window(text: str) -> tuple[str, RuleTable]:
    """What stands before `@START+LENGTH`, and the keys of the window; raises ValueError."""
    value, at, when = text.partition("@")
    if not at:
        return value, {}
    start, plus, length = when.partition("+")
    start_s = delay_s(start) if start or not plus else 0.0
    if not plus:
        return value, {"start_s": start_s}
    length_s = delay_s(length)
    if length_s == 0.0:
        raise ValueError(f"'{text}' lasts no time; write a length after the +")
    return value, {"start_s": start_s, "end_s": start_s + length_s}
