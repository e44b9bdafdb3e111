"""CSV and Parquet: one file for each message class, all its fields, written as the log is read."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

from fleet.export.columns import Column, Value, rows_of, table_columns
from fleet.extras import import_extra
from fleet.model.units import to_s
from fleet.protocol.classes import LOGGED_CLASSES
from fleet.protocol.codec import kind_of
from fleet.protocol.messages import Logged

BATCH_ROWS = 50_000
"""Rows that a Parquet file keeps in memory at a time."""

LOGGED = (("log_ns", int), ("log_s", float))
"""The first columns of every table: when the simulation had the message, in simulated time."""


class TableWriter(Protocol):
    """A file that takes rows."""

    def add(self, row: Sequence[Value]) -> None:
        """One more row."""

    def close(self) -> None:
        """No more rows."""


class Csv:
    """Comma-separated, with a header; UTF-8, LF, floats to the last digit, nothing for None."""

    suffix = "csv"

    def __init__(self, path: Path, columns: Sequence[tuple[str, type]]) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow([name for name, _ in columns])

    def add(self, row: Sequence[Value]) -> None:
        """Booleans become `true` and `false`."""
        self._writer.writerow([str(v).lower() if isinstance(v, bool) else v for v in row])

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Parquet:
    """Apache Parquet; needs the extra `parquet`."""

    suffix = "parquet"

    def __init__(self, path: Path, columns: Sequence[tuple[str, type]]) -> None:
        self._pa: Any = import_extra("pyarrow", "parquet")
        parquet: Any = import_extra("pyarrow.parquet", "parquet")
        pa = self._pa
        types = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string()}
        self._schema = pa.schema([(name, types[kind]) for name, kind in columns])
        self._writer = parquet.ParquetWriter(path, self._schema)
        self._rows: list[Sequence[Value]] = []

    def add(self, row: Sequence[Value]) -> None:
        """Written in batches."""
        self._rows.append(row)
        if len(self._rows) >= BATCH_ROWS:
            self._write()

    def close(self) -> None:
        """Write what is left, and the footer."""
        self._write()
        self._writer.close()

    def _write(self) -> None:
        columns = list(zip(*self._rows, strict=True)) or [()] * len(self._schema)
        arrays = [
            self._pa.array(values, type=field.type)
            for values, field in zip(columns, self._schema, strict=True)
        ]
        self._writer.write_table(self._pa.table(arrays, schema=self._schema))
        self._rows.clear()


def write_tables(
    folder: Path, messages: Iterable[tuple[str, Logged, int]], kind: type[Csv] | type[Parquet]
) -> dict[str, int]:
    """One table for each class in a folder, empty if nothing was said; returns their rows.

    Of messages as `fleet.log.Log.messages` gives them: topic, message, log time in ns.
    """
    columns = {cls.kind: table_columns(cls) for cls in LOGGED_CLASSES}
    rows = dict.fromkeys(columns, 0)
    with ExitStack() as stack:
        tables: dict[str, TableWriter] = {}
        for name, own in columns.items():
            table = kind(folder / f"{name}.{kind.suffix}", [*LOGGED, *_typed(own)])
            stack.callback(table.close)
            tables[name] = table
        for topic, message, log_ns in messages:
            name = kind_of(topic)
            for row in rows_of(message, columns[name]):
                tables[name].add((log_ns, to_s(log_ns), *row))
                rows[name] += 1
    return rows


def _typed(columns: Sequence[Column]) -> list[tuple[str, type]]:
    return [(column.name, column.type) for column in columns]
