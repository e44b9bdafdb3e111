"""The tables of docs/metrics.md, as the metrics are declared."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fleet.analysis.metrics import ROWS
from fleet.analysis.metrics.definition import metrics_in

HEAD = ["| Field | Symbol | Unit | Definition | Source |", "|---|---|---|---|---|"]


def table(row: type[Any]) -> str:
    """The fields of a class of rows."""
    lines = [
        f"| `{name}` | {m.symbol} | {m.unit} | {m.definition} | {m.source} |"
        for name, m in metrics_in(row).items()
    ]
    return "\n".join([*HEAD, *lines])


def parts() -> dict[str, Callable[[], str]]:
    """All of them, by the names of their parts."""
    return {f"fields of {row.__name__}": partial(table, row) for row in ROWS}
