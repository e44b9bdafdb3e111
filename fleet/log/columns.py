"""Messages as columns: numpy arrays, one row a message."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from fleet.extras import import_extra
from fleet.log.fields import FieldArray


class Columns:
    """Messages of one class in the order of the log, one array a field, n rows each.

    `t_ns` (int64) is when a message was sent, `log_ns` (int64) when the simulation recorded it,
    `seq` (int64) its number. The other arrays are named as the fields of the class, in its units:

    - numbers and truth values: (n,) of int64, float64 or bool
    - several numbers, as `position_ned_m`: (n, k)
    - text: (n,) of str objects
    - lists and maps, whose length varies: (n,) of tuples and dicts

    All are to be had as attributes (`columns.speed_mps`) and by name (`columns["speed_mps"]`).
    """

    def __init__(self, kind: str, arrays: Mapping[str, FieldArray]) -> None:
        """`kind` is the class, as in topics."""
        self.kind = kind
        self._arrays = dict(arrays)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(self._arrays)

    def __len__(self) -> int:
        """The number of messages."""
        return len(self._arrays["t_ns"])

    def __iter__(self) -> Iterator[str]:
        """The names of the columns."""
        return iter(self._arrays)

    def __getitem__(self, name: str) -> FieldArray:
        """A column; raises KeyError with the names there are."""
        try:
            return self._arrays[name]
        except KeyError:
            raise KeyError(self._unknown(name)) from None

    def __getattr__(self, name: str) -> FieldArray:
        """A column; raises AttributeError with the names there are."""
        if name.startswith("_") or name not in self._arrays:
            raise AttributeError(self._unknown(name))
        return self._arrays[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._arrays]

    def __repr__(self) -> str:
        return f"<{len(self):,} messages of class {self.kind}: {', '.join(self.names)}>"

    def rows(self, which: FieldArray | slice) -> Columns:
        """Some of the rows, chosen as numpy does."""
        return Columns(self.kind, {name: array[which] for name, array in self._arrays.items()})

    def frame(self, library: Literal["pandas", "polars"] = "pandas") -> Any:
        """A data frame with `t_ns`, `log_ns`, `seq` and the rest; (n, k) as k columns name_0 ...

        In polars a map is a list of its keys and values.

        Raises:
            MissingExtraError: the library is not installed.
            ValueError: it is neither pandas nor polars.

        """
        flat: dict[str, FieldArray] = {}
        for name, array in self._arrays.items():
            if array.ndim == 1:
                flat[name] = array
            else:
                flat |= {f"{name}_{k}": array[:, k] for k in range(array.shape[1])}
        if library not in ("pandas", "polars"):
            raise ValueError(f"'{library}' is not 'pandas' or 'polars'")
        frames: Any = import_extra(library, "analysis", "a frame")
        if library == "pandas":
            return frames.DataFrame(flat)
        plain = {n: _plain(a) if a.dtype == object else a for n, a in flat.items()}
        return frames.DataFrame(plain, infer_schema_length=None)

    def _unknown(self, name: str) -> str:
        return f"messages of class {self.kind} have no '{name}', but {', '.join(self.names)}"


def _plain(array: FieldArray) -> list[Any]:
    """Objects as polars takes them: it would drop keys that the first map does not have."""
    return [
        [{"key": k, "value": v} for k, v in item.items()] if isinstance(item, dict) else item
        for item in array.tolist()
    ]
