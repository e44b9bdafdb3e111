"""The columns of each message class as a table: nested fields side by side, lists down the rows.

A triple in NED becomes three columns, as in `position_north_m`. Each time in ns stands beside the
same in s. The classes in `ENTRIES` are lists of entries, and have a row for each, counted by
`entry`; lists and maps elsewhere are JSON text.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect

from fleet.model.units import to_s
from fleet.protocol.messages import Conflict, Decision, DeliveryReport

ENTRIES = frozenset({Conflict, Decision, DeliveryReport})
"""Classes that have a row for each entry of their lists; an empty one has a row without entries."""
AXES = ("north", "east", "down")

Value = int | float | bool | str | None
Getter = Callable[[Any, int], Any]


class Column(NamedTuple):
    """Name, type (int, float, bool or str), and how it is had from a message and an entry."""

    name: str
    type: type
    get: Getter


def table_columns(cls: type[msgspec.Struct]) -> tuple[Column, ...]:
    """The columns of a message class."""
    spread = cls in ENTRIES
    found = [Column("entry", int, _entry)] if spread else []
    for field in _fields(cls):
        found += _columns(field.name, field.type, _whole(field.name), spread=spread)
    return tuple(found)


def rows_of(message: msgspec.Struct, columns: tuple[Column, ...]) -> Iterator[list[Value]]:
    """The rows of a message."""
    entries = _entries(message) if type(message) in ENTRIES else 1
    for entry in range(max(1, entries)):
        yield [column.get(message, entry) for column in columns]


def _columns(name: str, kind: inspect.Type, get: Getter, *, spread: bool) -> list[Column]:
    """The columns that a field, or an entry of it, makes."""
    match kind:
        case inspect.IntType():
            column = Column(name, int, get)
            return [column, _in_seconds(column)] if name.endswith("_ns") else [column]
        case inspect.FloatType():
            return [Column(name, float, get)]
        case inspect.BoolType():
            return [Column(name, bool, get)]
        case inspect.StrType():
            return [Column(name, str, get)]
        case inspect.UnionType():  # what may be left out of a message
            (told,) = (k for k in kind.types if not isinstance(k, inspect.NoneType))
            return _columns(name, told, get, spread=False)
        case inspect.TupleType():
            return [
                column
                for n, item in enumerate(kind.item_types)
                for column in _columns(_part(name, n), item, _inside(get, n), spread=False)
            ]
        case inspect.StructType():
            return [
                column
                for field in _fields(kind.cls)
                for column in _columns(
                    field.name, field.type, _attribute(get, field.name), spread=False
                )
            ]
        case inspect.VarTupleType() if spread:
            return _columns(name, kind.item_type, _at_entry(get), spread=False)
        case inspect.VarTupleType() | inspect.DictType():
            return [Column(name, str, _as_json(get))]
    raise TypeError(f"{name}: no column for {kind}")


def _fields(cls: type[msgspec.Struct]) -> tuple[inspect.Field, ...]:
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    return info.fields


def _part(name: str, n: int) -> str:
    """The name of the n-th part of a tuple."""
    return name.replace("_ned_", f"_{AXES[n]}_") if "_ned_" in name else f"{name}_{n}"


def _entries(message: msgspec.Struct) -> int:
    values = (getattr(message, name) for name in message.__struct_fields__)
    return max(len(value) for value in values if isinstance(value, tuple))


# Getters. An entry that is not there (an empty list, a column not measured) is None throughout.


def _entry(message: Any, entry: int) -> int | None:
    return entry if _entries(message) else None


def _whole(name: str) -> Getter:
    of = attrgetter(name)
    return lambda message, _: of(message)


def _at_entry(get: Getter) -> Getter:
    def value(message: Any, entry: int) -> Any:
        entries = get(message, entry)
        return entries[entry] if entry < len(entries) else None

    return value


def _inside(get: Getter, n: int) -> Getter:
    def value(message: Any, entry: int) -> Any:
        whole = get(message, entry)
        return None if whole is None else whole[n]

    return value


def _attribute(get: Getter, name: str) -> Getter:
    def value(message: Any, entry: int) -> Any:
        whole = get(message, entry)
        return None if whole is None else getattr(whole, name)

    return value


def _in_seconds(column: Column) -> Column:
    def value(message: Any, entry: int) -> float | None:
        t_ns = column.get(message, entry)
        return None if t_ns is None else to_s(t_ns)

    return Column(f"{column.name.removesuffix('_ns')}_s", float, value)


def _as_json(get: Getter) -> Getter:
    def value(message: Any, entry: int) -> str | None:
        whole = get(message, entry)
        return None if whole is None else msgspec.json.encode(whole).decode()

    return value
