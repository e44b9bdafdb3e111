"""The metrics of a run as tables for people, from what the fields of its rows declare."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, get_type_hints

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from fleet.analysis.metrics import (
    Incursions,
    LinkMetrics,
    PairMetrics,
    RunMetrics,
    Spread,
    UavMetrics,
)
from fleet.analysis.metrics.definition import Metric, Shown, metrics_in
from fleet.analysis.metrics.pairs import ALERTS
from fleet.analysis.metrics.values import ZONE
from fleet.analysis.words import plain_text
from fleet.cli.screen import side_by_side

ROWS_SHOWN = 10

DIGITS = {"s": 1, "m": 1}
"""Digits behind the point by unit; numbers of other units have three."""

TextColumn = tuple[str, Callable[[Any], str]]
"""A heading, and the cell of a row; both as markup."""

PAIR: TextColumn = ("pair", lambda row: f"{row.a}-{row.b}")
UAV: TextColumn = ("UAV", lambda row: str(row.id))
CLASS: TextColumn = ("class", lambda row: escape(row.kind))


def metric_tables(run: RunMetrics, width: int) -> list[RenderableType]:
    """What people read of it; what is wider than `width` goes on in a further table."""
    tables = (_pairs(run), _alerts(run), _uavs(run))
    first = [part for table in tables for part in _fitting(_first(table), width)]
    return [*first, _facts(run), *_fitting(_classes(run), width)]


@dataclass(frozen=True)
class _Content:
    """What is in a table: `of` are its rows, in words."""

    title: str
    columns: Sequence[TextColumn]
    rows: Sequence[Any]
    of: str
    caption: str = ""


def _pairs(run: RunMetrics) -> _Content:
    columns = [PAIR, *_columns(PairMetrics, run)]
    return _Content("Pairs, nearest first", columns, run.pairs, "nearest pairs")


def _alerts(run: RunMetrics) -> _Content:
    columns = [PAIR, *_columns(PairMetrics, run, ALERTS)]
    alerted = [pair for pair in run.pairs if pair.alerted_s is not None or pair.losses.count]
    return _Content("Alerts, nearest pairs first", columns, alerted, "alerts")


def _uavs(run: RunMetrics) -> _Content:
    columns = [UAV, *_columns(UavMetrics, run)]
    order = sorted(run.uavs, key=lambda u: -max(u.path_deviation_max_m, u.altitude_deviation_max_m))
    return _Content("UAVs, farthest from plan first", columns, order, "UAVs")


def _classes(run: RunMetrics) -> _Content:
    columns = [CLASS, *_columns(LinkMetrics, run)]
    title, caption = (
        "Delivery and latency, all links together",
        "plan: what the fault plan lets one expect",
    )
    return _Content(title, columns, run.classes, "classes", caption)


def _facts(run: RunMetrics) -> Table:
    """What there is once: a line each."""
    table = Table(show_header=False)
    table.add_column()
    table.add_column(overflow="fold")
    for row in (run.totals, run, run.commands, run.elections):
        for name, metric, shown in _shown(type(row)):
            value = getattr(row, name)
            if shown.text is None and isinstance(value, dict):
                for key, part in value.items():
                    table.add_row(escape(key), _line(metric, part))
            else:
                text = _told(shown.text, row) if shown.text else _line(metric, value)
                table.add_row(escape(shown.heading), text)
    return table


def _shown(row: type[Any], table: str = "") -> Iterator[tuple[str, Metric, Shown]]:
    for name, metric in metrics_in(row).items():
        if metric.shown is not None and metric.shown.table == table:
            yield name, metric, metric.shown


def _columns(row: type[Any], run: RunMetrics, table: str = "") -> Iterator[TextColumn]:
    """The columns that a class of rows declares; incursions have one for each volume."""
    types = get_type_hints(row)
    for name, metric, shown in _shown(row, table):
        if types[name] is Incursions:
            yield ZONE, _cell_of(name, _held)
        elif types[name] == tuple[Incursions, ...]:
            for n, volume in enumerate(run.volumes):
                yield escape(volume.name), _cell_of(name, partial(_nth_held, n))
        elif shown.text is not None:
            yield escape(shown.heading), partial(_told, shown.text)
        else:
            yield escape(shown.heading), _cell_of(name, partial(_value, metric))


def _cell_of(name: str, text: Callable[[Any], str]) -> Callable[[Any], str]:
    """The cell of a field, by the text of its value."""
    return lambda row: text(getattr(row, name))


def _told(text: Callable[[Any], str], row: Any) -> str:
    return escape(text(row))


def _first(content: _Content) -> _Content:
    """As many rows as people look at."""
    count = len(content.rows)
    if count <= ROWS_SHOWN:
        return content
    caption = f"the first {ROWS_SHOWN} of {count} {content.of}"
    return replace(content, rows=content.rows[:ROWS_SHOWN], caption=caption)


def _fitting(content: _Content, width: int) -> list[Table]:
    """The table, or several: the title is over the first, the caption under the last."""
    return side_by_side(partial(_table, content), len(content.columns), width)


def _table(content: _Content, picked: Sequence[int]) -> Table:
    table = Table(title_justify="left")
    if 1 in picked:
        table.title = content.title
    if len(content.columns) - 1 in picked:
        table.caption = content.caption or None
    columns = [content.columns[n] for n in picked]
    for n, (heading, _) in enumerate(columns):
        table.add_column(heading, justify="right" if n else "left")
    for row in content.rows:
        table.add_row(*(cell(row) for _, cell in columns))
    return table


def _held(held: Incursions) -> str:
    if not held.count:
        return "[green]kept[/]"
    times = f"{held.count} x, " if held.count > 1 else ""
    return f"[bold red]{times}{held.duration_s:.1f} s, {held.severity:.0%}[/]"


def _nth_held(n: int, held: Sequence[Incursions]) -> str:
    return _held(held[n])


def _value(metric: Metric, value: Any) -> str:
    """A value without its unit; of a spread the mean."""
    if isinstance(value, Spread):
        return _number(value.mean, 3)
    if isinstance(value, float) or value is None:
        return _number(value, DIGITS.get(metric.unit, 3))
    return escape(plain_text(value))


def _line(metric: Metric, value: Any) -> str:
    """A value with its unit."""
    if isinstance(value, Spread):
        told = {"mean": value.mean, "p50": value.p50, "p99": value.p99, "max": value.max}
        parts = [f"{name} {_number(part, 3)} {metric.unit}" for name, part in told.items()]
        return ", ".join(parts) if value.count else "-"
    unit = f" {metric.unit}" if isinstance(value, float) and metric.unit not in "-1" else ""
    return _value(metric, value) + unit


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
