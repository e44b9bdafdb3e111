"""A metric is declared once: its formula makes the value, and every reader has it from there."""

from __future__ import annotations

from collections import Counter
from dataclasses import FrozenInstanceError, replace
from io import StringIO

import pytest
from rich.console import Console

from fleet.analysis import metrics
from fleet.analysis.comparison import comparison
from fleet.analysis.metrics import RunMetrics, SafetyTotals, Tolerance, measure
from fleet.analysis.metrics.data import run_arrays
from fleet.analysis.metrics.definition import (
    Compared,
    MetricOf,
    MetricRow,
    Shown,
    described,
    metric_row,
    metrics_in,
    of_known,
)
from fleet.analysis.metrics.totals import RunOnRecord, total
from fleet.analysis.metrics.uavs import measure_uavs
from fleet.analysis.metrics.values import BY_VOLUME, Spread
from fleet.cli.metric_tables import metric_tables
from fleet.config.scenario import Scenario
from tests.analysis.test_metrics import flown, two
from tests.support.mutants import meeting
from tools.metric_docs import HEAD, table

word_metric = MetricOf[str]()


@metric_row
class WordMetrics(MetricRow[str]):
    """A word."""

    length: int = word_metric("1", "its letters", len, symbol="n", source="Euclid")
    first: str = word_metric("-", "how it begins", lambda word: word[0])


@metric_row
class LongerTotals(SafetyTotals):
    """The totals with one more."""

    flown_longest_s: float = total(
        "s",
        "time of the longest flight",
        lambda run: max(uav.flown_s for uav in run.uavs),
        shown=Shown("longest flight"),
        compared=Compared(),
    )
    flown_spread_s: Spread = total(
        "s",
        "how long they flew",
        lambda run: Spread.of(uav.flown_s for uav in run.uavs),
        compared=Compared("flown_s", lambda spread: {"least": spread.p50, "most": spread.max}),
    )


@pytest.fixture(scope="module")
def run() -> RunMetrics:
    return measure(flown(meeting()))


def longer(scenario: Scenario) -> RunMetrics:
    """A run measured with these totals."""
    found = flown(scenario)
    run, data = measure(found), run_arrays(found)
    arrivals, uavs = measure_uavs(data, Tolerance())
    totals = LongerTotals.of(RunOnRecord(data, run.pairs, uavs, arrivals, run.volumes))
    return replace(run, totals=totals)


def text_of(run: RunMetrics) -> str:
    console = Console(width=200, file=StringIO())
    with console.capture() as captured:
        console.print(*metric_tables(run, console.width))
    return captured.get()


def test_the_formula_makes_the_value() -> None:
    word = WordMetrics.of("zone")
    assert (word.length, word.first) == (4, "z")
    assert word == WordMetrics(4, "z")
    with pytest.raises(FrozenInstanceError):
        word.length = 5  # type: ignore[misc]


def test_the_documents_have_what_is_declared() -> None:
    rows = [
        "| `length` | n | 1 | its letters | Euclid |",
        "| `first` | - | - | how it begins | ours |",
    ]
    assert table(WordMetrics).splitlines() == [*HEAD, *rows]


def test_what_has_no_formula_is_given_or_has_its_default() -> None:
    @metric_row
    class Given:
        a: int = described("1", "given")
        b: int = described("1", "given or 2", default=2)

    assert Given(1).b == 2
    with pytest.raises(TypeError, match="'a'"):
        Given()  # type: ignore[call-arg]
    assert [m.formula for m in metrics_in(Given).values()] == [None, None]


def test_a_field_more_is_in_json_tables_and_comparison() -> None:
    run = longer(two(duration_s=4.0))
    assert run.as_dict()["totals"]["flown_longest_s"] == 4.0
    assert "│ longest flight        │ 4.0 s " in text_of(run)
    results = comparison([run, run])["results"]
    assert results["flown_longest_s"] == [4.0, 4.0]
    assert (results["flown_s_least"], results["flown_s_most"]) == ([4.0, 4.0], [4.0, 4.0])


def test_everything_declared_is_shown(run: RunMetrics) -> None:
    text = text_of(run)
    for row in metrics.ROWS:
        for metric in metrics_in(row).values():
            if metric.shown is not None and metric.shown.heading != BY_VOLUME:
                assert metric.shown.heading in text
    assert text.count("nmac") == 2
    assert text.count("zone") == 1


def test_everything_declared_is_compared_as_one_value_under_its_own_name(run: RunMetrics) -> None:
    results = comparison([run])["results"]
    told = Counter(
        metric.compared.name or name
        for row in metrics.ROWS
        for name, metric in metrics_in(row).items()
        if metric.compared is not None
    )
    assert set(told.values()) == {1}
    for name in told:
        found = [key for key in results if key == name or key.startswith(f"{name}_")]
        assert found, name
    for (value,) in results.values():
        assert not isinstance(value, list | tuple | dict | Spread)


def test_a_summary_of_what_is_known_takes_an_empty_list_and_nones() -> None:
    greatest = of_known(max)
    assert [greatest(values) for values in ([], [None], [1.0, None, 3.0])] == [None, None, 3.0]
