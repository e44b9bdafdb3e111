"""How a metric is declared: a field of a row, with its unit, definition and formula beside it.

JSON, CSV files, the tables of `fleet metrics` and of docs/metrics.md, and `fleet compare` are made
from that (docs/extending/metric.md says how to add one).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Generic, Self, TypedDict, TypeVar, Unpack, cast, dataclass_transform

_Source = TypeVar("_Source")
_Value = TypeVar("_Value")
_Row = TypeVar("_Row")

DEFINED = "metric"


@dataclass(frozen=True)
class Shown:
    """A place in the tables of `fleet metrics`: a column of rows, or a line of what is there once.

    `text` makes it of the row where the value alone does not tell; `table` names the table where
    rows have several.
    """

    heading: str
    text: Callable[[Any], str] | None = None
    table: str = ""


@dataclass(frozen=True)
class Compared:
    """A row of `fleet compare`, named as the field unless it has a name of its own there.

    `summary` makes one value of that of the run or, where a run has many rows, of a list of theirs,
    which may be empty and hold None; `of_known` makes such a one of `max` or `min`.
    A mapping gives a row for each of its keys.
    """

    name: str = ""
    summary: Callable[[Any], Any] | None = None


def of_known(summary: Callable[[Iterable[Any]], Any]) -> Callable[[Iterable[Any]], Any]:
    """A summary of those values that are known: None if none is."""

    def summarised(values: Iterable[Any]) -> Any:
        known = [value for value in values if value is not None]
        return summary(known) if known else None

    return summarised


class MetricOptions(TypedDict, total=False):
    """What a metric may say beside unit, definition and formula."""

    symbol: str
    source: str
    shown: Shown
    compared: Compared


@dataclass(frozen=True)
class Metric:
    """What is declared of a field. The unit is `1` of plain numbers and `-` of what is none.

    `definition`, `symbol` and `source` (who defined it so) are Markdown for docs/metrics.md. What
    has no formula is set where the row is made.
    """

    unit: str
    definition: str
    formula: Callable[[Any], Any] | None = None
    symbol: str = "-"
    source: str = "ours"
    shown: Shown | None = None
    compared: Compared | None = None


class MetricOf(Generic[_Source]):
    """Declares metrics whose formulas take what is on record of a pair, a UAV, a run.

    ```
    uav_metric = MetricOf[UavOnRecord]()

    @metric_row
    class UavMetrics(MetricRow[UavOnRecord]):
        flown_s: float = uav_metric("s", "from its first true state to the last", lambda uav: ...)
    ```
    """

    def __call__(
        self,
        unit: str,
        definition: str,
        formula: Callable[[_Source], _Value],
        **options: Unpack[MetricOptions],
    ) -> _Value:
        """A field of a row; the type of the field is that of the formula's values."""
        told = Metric(unit, definition, formula, **options)
        return cast("_Value", field(metadata={DEFINED: told}))


def described(
    unit: str, definition: str, default: Any = MISSING, **options: Unpack[MetricOptions]
) -> Any:
    """A field without a formula."""
    told = Metric(unit, definition, **options)
    return field(default=default, metadata={DEFINED: told})


@dataclass_transform(frozen_default=True, field_specifiers=(described,))
def metric_row(cls: type[_Row]) -> type[_Row]:
    """Make a class of rows: frozen, and every field declared."""
    return dataclass(frozen=True, slots=True)(cls)


class MetricRow(Generic[_Source]):
    """A row that is computed from what is on record."""

    __slots__ = ()

    @classmethod
    def of(cls, source: _Source) -> Self:
        """The row, from what is on record."""
        values = {n: m.formula(source) for n, m in metrics_in(cls).items() if m.formula}
        return cls(**values)


def metrics_in(row: type[Any]) -> dict[str, Metric]:
    """What is declared of the fields of a class of rows, in their order."""
    return {f.name: f.metadata[DEFINED] for f in fields(row)}
