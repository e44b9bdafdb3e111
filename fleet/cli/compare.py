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
    """The same for people: all runs beside each other, or as many as fit and the rest below.

    Then the settings are a table of their own, and what is the same in all runs comes once.
    """
    settings, results = found["settings"], found["results"]
    same = {n: v for n, v in settings.items() if _is_same(v)}
    shown = {n: v for n, v in settings.items() if n not in same}
    tables = side_by_side(partial(_table, logs, (shown, results)), len(logs) + 1, width)
    if len(tables) > 1:
        texts = {n: [_result_text(n, x) for x in v] for n, v in results.items()}
        equal = {n: v for n, v in results.items() if _is_same(texts[n])}
        differing = {n: v for n, v in results.items() if n not in equal}
        tables = side_by_side(partial(_settings, logs, shown), len(shown) + 1, width)
        if differing:
            tables += side_by_side(partial(_table, logs, (differing,)), len(logs) + 1, width)
        tables.append(_table(["all"], (equal,), (0, 1)))
    if same:
        words = ", ".join(f"{name} {_text(values[0])}" for name, values in same.items())
        tables[-1].caption = escape(f"the same in all: {words}")
    return tables


def _is_same(values: Sequence[Any]) -> bool:
    """Whether all of several runs have the same value."""
    return len(values) > 1 and all(value == values[0] for value in values)


def _settings(logs: Sequence[str], settings: SideBySide, picked: Sequence[int]) -> Table:
    """A row a run, whose name is column 0, and some of the settings, which are those from 1 on."""
    table, names = Table(), list(settings)
    table.add_column(no_wrap=True)
    for n in picked[1:]:
        table.add_column(escape(names[n - 1]))
    for run, log in enumerate(logs):
        values = [_text(settings[names[n - 1]][run]) for n in picked[1:]]
        table.add_row(escape(name_in_lines(log, LOG_WIDE)), *map(escape, values))
    return table


def _table(logs: Sequence[str], parts: Sequence[SideBySide], picked: Sequence[int]) -> Table:
    """Of the names, which are column 0, and some of the runs, which are those from 1 on."""
    table, runs = Table(), [n - 1 for n in picked[1:]]
    table.add_column(no_wrap=True)
    for n in runs:
        table.add_column(escape(name_in_lines(logs[n], LOG_WIDE)), justify="right", overflow="fold")
    for part in parts:
        for name, column in part.items():
            table.add_row(escape(name), *(escape(_result_text(name, column[n])) for n in runs))
        table.add_section()
    return table


def _result_text(name: str, value: Any) -> str:
    if value is not None and name == "least_separation":
        return separation_text(value)
    return _text(value)


def _text(value: Any) -> str:
    if value is None or value == []:
        return "-"
    if isinstance(value, list):
        return "\n".join(map(_text, value))
    return f"{round(value, 9):.4g}" if isinstance(value, float) else plain_text(value)
