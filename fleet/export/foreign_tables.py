"""Tables of what other programs have added to a log: one file a topic, columns as its maps have.

Nested maps lie side by side, as in `cell.volts`; lists are JSON text. What is no map is the column
`value`. The log is read twice: the columns are known only at the end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from fleet.export.columns import Value
from fleet.export.tables import LOGGED, Csv, Parquet, TableWriter
from fleet.log.foreign import ForeignDecoder, ForeignMessage
from fleet.log.store import Log
from fleet.model.units import to_s
from fleet.printing import printable

MAX_TABLES = 100
"""So many topics get a table, one file each,"""
MAX_COLUMNS = 500
"""and so many columns at most."""
INT64 = range(-(1 << 63), 1 << 63)

_RESERVED = frozenset(name for name, _ in LOGGED)


@dataclass
class ForeignTables:
    """What was written: rows by file, and in words what was left out."""

    rows: dict[str, int] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


@dataclass
class _Table:
    """A topic: its file's name, its columns with their types (None: nothing but None so far)."""

    name: str
    columns: dict[str, type | None] = field(default_factory=dict)
    dropped: int = 0

    def learn(self, row: dict[str, Value]) -> None:
        for name, value in row.items():
            if name not in self.columns and len(self.columns) >= MAX_COLUMNS:
                self.dropped += 1
            else:
                self.columns[name] = _wider(self.columns.get(name), _type_of(value))

    def typed(self) -> list[tuple[str, type]]:
        return [(name, kind or str) for name, kind in self.columns.items()]

    def cells(self, row: dict[str, Value]) -> list[Value]:
        return [_as(row.get(name), kind) for name, kind in self.typed()]


def write_foreign_tables(folder: Path, log: Log, kind: type[Csv] | type[Parquet]) -> ForeignTables:
    """One table for each foreign topic whose messages can be decoded; nothing without such."""
    found = ForeignTables()
    tables, decoder = _tables(log, found), ForeignDecoder()
    for topic, row, _ in _rows(log, tables, decoder):
        tables[topic].learn(row)
    if decoder.failed:
        found.left_out.append(decoder.problem())
    with ExitStack() as stack:
        writers: dict[str, TableWriter] = {}
        for topic, table in tables.items():
            path = folder / f"{table.name}.{kind.suffix}"
            writer = kind(path, [*LOGGED, *table.typed()])
            stack.callback(writer.close)
            writers[topic] = writer
            found.rows[table.name] = 0
            if table.dropped:
                found.left_out.append(f"{topic} has more than {MAX_COLUMNS} columns")
        for topic, row, log_ns in _rows(log, tables, ForeignDecoder()):
            writers[topic].add((log_ns, to_s(log_ns), *tables[topic].cells(row)))
            found.rows[tables[topic].name] += 1
    return found


def _tables(log: Log, found: ForeignTables) -> dict[str, _Table]:
    """The topics that get a table; notes the others."""
    tables: dict[str, _Table] = {}
    names: set[str] = set()
    for told in log.foreign:
        if not ForeignMessage(told.encoding, b"").has_decoder:
            found.left_out.append(f"{told.messages:,} of {told.topic} in '{told.encoding}'")
        elif told.topic not in tables and len(tables) >= MAX_TABLES:
            found.left_out.append(f"{told.messages:,} of {told.topic}, as {MAX_TABLES} are written")
        elif told.topic not in tables:
            name = _file_name(told.topic, names)
            names.add(name.lower())
            tables[told.topic] = _Table(name)
    return tables


def _rows(
    log: Log, tables: dict[str, _Table], decoder: ForeignDecoder
) -> Iterator[tuple[str, dict[str, Value], int]]:
    """Topic, row and time of all messages that can be decoded."""
    if not tables:
        return
    for topic, message, log_ns in log.all_messages([*tables]):
        if isinstance(message, ForeignMessage):
            try:
                value = decoder.value(topic, message, log_ns)
            except ValueError:
                continue
            yield topic, dict(_flat(value)), log_ns


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Value]]:
    if isinstance(value, dict) and value:
        for key, part in value.items():
            yield from _flat(part, f"{name}.{key}" if name else key)
    else:
        column = printable(name) or "value"
        plain = _json(value) if isinstance(value, list | dict) else value
        yield (f"data.{column}" if column in _RESERVED else column), plain


def _file_name(topic: str, taken: set[str]) -> str:
    plain = "foreign_" + re.sub(r"[^A-Za-z0-9-]+", "_", topic).strip("_")[:80]
    name, n = plain, 1
    while name.lower() in taken:
        n += 1
        name = f"{plain}_{n}"
    return name


def _type_of(value: Value) -> type | None:
    if value is None:
        return None
    return str if type(value) is int and value not in INT64 else type(value)


def _wider(one: type | None, other: type | None) -> type | None:
    """The type of a column with values of both."""
    if one is None or one is other:
        return other
    if other is None:
        return one
    return float if {one, other} == {int, float} else str


def _as(value: Value, kind: type) -> Value:
    if value is None or type(value) is kind:
        return value
    return float(value) if kind is float else _json(value)


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()
