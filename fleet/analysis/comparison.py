"""Runs side by side: in which settings they differ, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from fleet.analysis.metrics import (
    CommandRow,
    LinkMetrics,
    PairMetrics,
    RunMetrics,
    TermRow,
    UavMetrics,
)
from fleet.analysis.metrics.definition import metrics_in
from fleet.model.words import ClockMode

ALWAYS = ("name", "seed", "fault")
"""Settings that are told though they do not differ."""

SideBySide = dict[str, list[Any]]
"""A value for each run, by name."""


def comparison(runs: Sequence[RunMetrics]) -> dict[str, SideBySide]:
    """`settings`, those that differ first, and `results`."""
    told = [_settings(run) for run in runs]
    names = dict.fromkeys(name for settings in told for name in settings)
    columns = {name: [settings.get(name) for settings in told] for name in names}
    differing = [name for name, values in columns.items() if any(v != values[0] for v in values)]
    shown = dict.fromkeys([*differing, *ALWAYS])
    results = [_results(run) for run in runs]
    found = dict.fromkeys(name for result in results for name in result)
    return {
        "settings": {name: columns[name] for name in shown},
        "results": {name: [result.get(name) for result in results] for name in found},
    }


def _settings(run: RunMetrics) -> dict[str, Any]:
    """All settings of a run by dotted name; the faults are those in force at its end."""
    table = msgspec.to_builtins(run.scenario)
    del table["description"], table["fault"]
    faults = [rule.words(when=True) for rule in run.plan]
    clock = ClockMode.REALTIME if run.realtime else ClockMode.LOCKSTEP
    return {
        "name": table.pop("name"),
        "seed": table.pop("seed"),
        "fault": faults,
        "clock": clock,
    } | _flat(table)


def _flat(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            out |= _flat(value, f"{prefix}{key}.")
        elif key == "uav":
            for uav in value:
                out |= _flat(uav, f"{prefix}uav.{uav['id']}.")
        else:
            out[f"{prefix}{key}"] = value
    return out


def _results(run: RunMetrics) -> dict[str, Any]:
    """What came of a run: all that its metrics declare to be compared."""
    return {
        **_of_one(run.totals),
        **_of_all(PairMetrics, run.pairs),
        **_of_all(UavMetrics, run.uavs),
        **_of_one(run.commands),
        **_of_all(CommandRow, run.commands.rows),
        **_of_one(run.elections),
        **_of_all(TermRow, run.elections.rows),
        **_by_class(run.classes),
        **_of_one(run),
    }


def _of_one(row: Any) -> dict[str, Any]:
    return _compared(type(row), lambda name: getattr(row, name))


def _of_all(cls: type[Any], rows: Sequence[Any]) -> dict[str, Any]:
    return _compared(cls, lambda name: [getattr(row, name) for row in rows])


def _by_class(rows: Sequence[LinkMetrics]) -> dict[str, Any]:
    return _compared(LinkMetrics, lambda name: {row.kind: getattr(row, name) for row in rows})


def _compared(cls: type[Any], value_of: Callable[[str], Any]) -> dict[str, Any]:
    """The metrics of a class of rows that are compared, from the values of its fields."""
    out: dict[str, Any] = {}
    for field, metric in metrics_in(cls).items():
        compared = metric.compared
        if compared is None:
            continue
        value = value_of(field)
        if compared.summary is not None:
            value = compared.summary(value)
        name = compared.name or field
        if isinstance(value, dict):
            out |= {f"{name}_{key}": part for key, part in value.items()}
        else:
            out[name] = value
    return out
