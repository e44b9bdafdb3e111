"""The columns that the fields of a message class become."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from msgspec import inspect
from numpy.typing import NDArray

FieldArray = NDArray[Any]


@dataclass(frozen=True)
class Field:
    """A column: its name, type, and bounds; `width` numbers a message (0: a plain number).

    Columns that are not of fixed size or not of numbers, texts and truth values are objects. A
    number that may be left out of a message is NaN then.
    """

    name: str
    dtype: type
    width: int = 0
    low: float | None = None
    high: float | None = None
    text: bool = False
    optional: bool = False

    @property
    def fixed(self) -> bool:
        """Whether it has the same place in all messages of one template."""
        return self.text or self.dtype is not object

    def column(self, n: int) -> FieldArray:
        """An empty column for n messages."""
        return np.empty((n, self.width) if self.width else n, self.dtype)


def fields_of(cls: type[msgspec.Struct]) -> list[Field]:
    """The columns of a class."""
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    return [_field(field) for field in info.fields]


def _field(of: inspect.Field) -> Field:
    """The column of a field of a message."""
    kind: inspect.Type = of.type
    width = 0
    if isinstance(kind, inspect.UnionType):
        kinds = [k for k in kind.types if not isinstance(k, inspect.NoneType)]
        if len(kinds) == 1 and isinstance(kinds[0], inspect.FloatType):
            return Field(of.name, np.float64, 0, kinds[0].ge, kinds[0].le, optional=True)
    if isinstance(kind, inspect.TupleType):
        width = len(kind.item_types)
        if len(set(map(repr, kind.item_types))) > 1:
            return Field(of.name, object)
        kind = kind.item_types[0]
    match kind:
        case inspect.FloatType() | inspect.IntType():
            dtype = np.float64 if isinstance(kind, inspect.FloatType) else np.int64
            high = kind.lt - 1 if kind.lt is not None else kind.le
            return Field(of.name, dtype, width, kind.ge, high)
        case inspect.BoolType():
            return Field(of.name, bool, width)
        case inspect.StrType() if not width:
            return Field(of.name, object, text=True)
    return Field(of.name, object)
