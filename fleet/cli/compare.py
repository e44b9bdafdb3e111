"""Runs side by side, as tables for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from fleet.analysis.comparison import SideBySide
from fleet.analysis.words import separation_text

NAMES_WIDE, RUN_WIDE = 32, 13
"""Columns of text that the names take, and each run."""


def comparison_tables(logs: Sequence[str], found: dict[str, SideBySide], width: int) -> list[Table]:
    """The same for people: as many runs beside each other as fit, then the next ones below."""
    beside = max(1, (width - NAMES_WIDE) // RUN_WIDE)
    parts = [slice(n, n + beside) for n in range(0, len(logs), beside)]
    settings, results = found["settings"], found["results"]
    same = {n: v[0] for n, v in settings.items() if len(v) > 1 and all(x == v[0] for x in v)}
    shown = {n: v for n, v in settings.items() if n not in same}
    tables = [_table(logs[part], (shown, results), part) for part in parts]
    if same:
        words = ", ".join(f"{name} {_text(value)}" for name, value in same.items())
        tables[-1].caption = escape(f"the same in all: {words}")
    return tables


def _table(logs: Sequence[str], parts: Sequence[SideBySide], picked: slice) -> Table:
    table = Table()
    table.add_column(no_wrap=True)
    for log in logs:
        table.add_column(escape(log), justify="right", overflow="fold")
    for part in parts:
        for name, column in part.items():
            values = column[picked]
            text = separation_text if name == "least_separation" else _text
            table.add_row(escape(name), *("-" if v is None else escape(text(v)) for v in values))
        table.add_section()
    return table


def _text(value: Any) -> str:
    if value is None or value == []:
        return "-"
    if isinstance(value, list):
        return "\n".join(map(_text, value))
    return f"{round(value, 9):.4g}" if isinstance(value, float) else str(value)
