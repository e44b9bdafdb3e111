"""What a study says of each cell: probabilities with intervals, and how runs are distributed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.analysis.words import counted
from fleet.model.types import Array, Truths
from fleet.study.design import Cell
from fleet.study.results import ResultsFolder
from fleet.study.statistics.estimate import LEVEL, Estimate
from fleet.study.statistics.paired import effect_of_avoidance
from fleet.study.statistics.quantiles import quantile_by_order
from fleet.study.statistics.stopping import StoppingRule
from fleet.study.statistics.weights import effective_runs, weighted_proportion, weighted_risk_ratio
from fleet.study.study_file import Study

EVENTS = ("lost", "nmac")
"""The two events of a run, each with and without avoidance."""

SPREADS = (
    "least_separation",
    "delay_max_s",
    "path_deviation_max_m",
    "command_latency_s",
    "commands",
)
"""Outcomes of which quantiles are told."""
SHARES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class EventSummary:
    """An event (loss of separation, or NMAC) in the runs of a cell: probabilities per run.

    The risk ratio is that with avoidance by that without, on the same encounters. `induced` is the
    probability of the event with avoidance only, `unresolved` that of the event with and without.
    Where runs have weights, all are of encounters as they occur.
    """

    probability: Estimate
    without: Estimate
    risk_ratio: Estimate
    induced: Estimate
    unresolved: Estimate


@dataclass(frozen=True)
class CellSummary:
    """A cell: runs flown and failed, its events, and quantiles of outcomes (by `SHARES`).

    Runs that have weights have no quantiles, which would be of encounters as they were drawn.
    `worth` is Kish's effective number of runs: as many as were flown where all weigh the same.
    `alike` says that all its runs, two or more, came to one digest: no chance is in them.
    """

    cell: Cell
    runs: int
    failed: int
    worth: float
    events: dict[str, EventSummary]
    quantiles: dict[str, tuple[Estimate, ...]]
    not_arrived: int
    due: int
    alike: bool


def summaries(results: ResultsFolder, level: float = LEVEL) -> list[CellSummary]:
    """Each cell's summary, in order; a cell of which no run was flown has no events."""
    table = results.table()
    return [_summary(results.study, cell, rows, level) for cell, rows in by_cell(results, table)]


def alike_words(found: Sequence[CellSummary]) -> str:
    """That runs of some cells are all the same, as a sentence; empty if that is so in none."""
    alike = sum(cell.alike for cell in found)
    if not alike:
        return ""
    return (
        f"All runs of {counted(alike, 'cell')} are the same, since nothing in them is left to "
        "chance: they count as one, and intervals of them mean nothing. Scatter the encounters."
    )


def by_cell(results: ResultsFolder, table: Any) -> Iterator[tuple[Cell, dict[str, Any]]]:
    """Each cell with its rows, as columns of numpy; what is missing is None or NaN."""
    columns = {name: column_of(table, name) for name in table.column_names}
    of = columns["cell"].astype(np.int64)
    for cell in results.cells:
        low, high = np.searchsorted(of, [cell.number, cell.number + 1])
        yield cell, {name: values[low:high] for name, values in columns.items()}


def column_of(table: Any, name: str) -> Any:
    """A column as a numpy array; numbers that are missing are NaN."""
    column = table[name]
    return column.to_numpy() if column.null_count == 0 else np.array(column.to_pandas())


def _summary(study: Study, cell: Cell, rows: dict[str, Any], level: float) -> CellSummary:
    flown = rows["error"] == ""
    known = {name: values[flown] for name, values in rows.items()}
    weights = known["weight"].astype(np.float64)
    count = len(weights)
    equal = count > 0 and bool(weights.min() == weights.max())
    return CellSummary(
        cell,
        count,
        int(np.count_nonzero(~flown)),
        effective_runs(weights) if count else 0.0,
        {event: _event(study, event, known, weights, level) for event in EVENTS if count},
        {name: _quantiles(known[name], level) for name in SPREADS if equal},
        int(known["not_arrived"].sum()),
        int(known["due"].sum()),
        count > 1 and len(set(known["digest"])) == 1 and bool(known["digest"][0]),
    )


def _event(
    study: Study, event: str, known: dict[str, Any], weights: Array, level: float
) -> EventSummary:
    happened: Truths = known[event].astype(np.bool_)
    without: Truths = known[f"{event}_without"].astype(np.bool_)
    if weights.min() < weights.max():
        return _weighted_event(happened, without, weights, level)
    effect = effect_of_avoidance(happened, without, level)
    probability = effect.lost_with
    if study.stop and study.stop.event == event:
        rule = StoppingRule(study.stop.half_width, study.runs, level)
        probability = rule.estimate(int(happened.sum()), len(happened))
    return EventSummary(
        probability, effect.lost_without, effect.ratio, effect.induced, effect.unresolved
    )


def _weighted_event(
    happened: Truths, without: Truths, weights: Array, level: float
) -> EventSummary:
    def share(events: Truths) -> Estimate:
        return weighted_proportion(events, weights, level).estimate

    return EventSummary(
        share(happened),
        share(without),
        weighted_risk_ratio(happened, without, weights, level),
        induced=share(happened & ~without),
        unresolved=share(happened & without),
    )


def _quantiles(values: Array, level: float) -> tuple[Estimate, ...]:
    """Quantiles of one value a run, of those runs that have one."""
    numbers = np.asarray(values, dtype=np.float64)
    numbers = numbers[~np.isnan(numbers)]
    return tuple(quantile_by_order(numbers, share, level) for share in SHARES if len(numbers))
