"""Runs side by side, as tables for people."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from rich.markup import escape
from rich.table import Table

from fleet.analysis.comparison import SideBySide
from fleet.analysis.words import plain_text, separation_text
from fleet.cli.screen import name_in_lines, side_by_side

LOG_WIDE = 14
"""Columns of text for the name of a log; longer ones take several lines."""


def comparison_tables(logs: Sequence[str], found: dict[str, SideBySide], width: int) -> list[Table]:
    """The same for people: as many runs beside each other as fit, then the next ones below."""
    settings, results = found["settings"], found["results"]
    same = {n: v[0] for n, v in settings.items() if len(v) > 1 and all(x == v[0] for x in v)}
    shown = {n: v for n, v in settings.items() if n not in same}
    tables = side_by_side(partial(_table, logs, (shown, results)), len(logs) + 1, width)
    if same:
        words = ", ".join(f"{name} {_text(value)}" for name, value in same.items())
        tables[-1].caption = escape(f"the same in all: {words}")
    return tables


def _table(logs: Sequence[str], parts: Sequence[SideBySide], picked: Sequence[int]) -> Table:
    """Of the names, which are column 0, and some of the runs, which are those from 1 on."""
    table, runs = Table(), [n - 1 for n in picked[1:]]
    table.add_column(no_wrap=True)
    for n in runs:
        table.add_column(escape(name_in_lines(logs[n], LOG_WIDE)), justify="right", overflow="fold")
    for part in parts:
        for name, column in part.items():
            values = [column[n] for n in runs]
            text = separation_text if name == "least_separation" else _text
            table.add_row(escape(name), *("-" if v is None else escape(text(v)) for v in values))
        table.add_section()
    return table


def _text(value: Any) -> str:
    if value is None or value == []:
        return "-"
    if isinstance(value, list):
        return "\n".join(map(_text, value))
    return f"{round(value, 9):.4g}" if isinstance(value, float) else plain_text(value)
