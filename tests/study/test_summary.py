"""What a study says of its cells, of rows that were written by hand."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from rich.console import Console

from fleet.cli.study_table import study_tables
from fleet.study.loading import load_study
from fleet.study.results import ResultsFolder
from fleet.study.run_row import RunRow
from fleet.study.summary import alike_words, summaries

TABLE: dict[str, Any] = {
    "name": "by_hand",
    "runs": 10,
    "encounters": {"kind": "pairs"},
    "factor": [{"name": "loss", "fault": "loss", "unit": "%", "values": [0, 50]}],
}
FLOWN = RunRow(
    cell=0,
    run=0,
    seed=1,
    uavs=2,
    lost=False,
    nmac=False,
    lost_without=True,
    nmac_without=False,
    least_separation=1.1,
    delay_max_s=2.0,
    path_deviation_max_m=30.0,
    command_latency_s=0.2,
    commands=2,
    due=2,
    not_arrived=0,
)


def written(folder: Path, rows: list[RunRow], **changes: Any) -> ResultsFolder:
    results = ResultsFolder.create(folder, load_study({**TABLE, **changes}))
    results.add(rows)
    return results


def test_probabilities_are_those_of_counting_and_intervals_those_of_tables(tmp_path: Path) -> None:
    """3 of 10 and 0 of 10 by Clopper and Pearson, 9 of 10 without avoidance."""
    rows = [
        replace(FLOWN, cell=cell, run=n, lost=cell == 1 and n < 3, lost_without=n > 0)
        for cell in (0, 1)
        for n in range(10)
    ]
    good, bad = summaries(written(tmp_path, rows))
    lost = bad.events["lost"]
    assert (lost.probability.value, lost.without.value) == (0.3, 0.9)
    assert lost.probability.low == pytest.approx(0.0667, abs=1e-4)
    assert lost.probability.high == pytest.approx(0.6525, abs=1e-4)
    assert lost.risk_ratio is not None
    assert lost.risk_ratio.value == pytest.approx(3 / 9)
    assert lost.induced is not None
    assert lost.induced.value == pytest.approx(0.1)  # run 0 is lost with avoidance only
    assert lost.unresolved is not None
    assert lost.unresolved.value == pytest.approx(0.2)
    assert good.events["lost"].probability.value == 0.0
    assert good.events["lost"].probability.high == pytest.approx(0.3085, abs=1e-4)
    assert bad.events["nmac"].probability.value == 0.0
    assert (bad.runs, bad.failed, bad.worth, bad.due, bad.not_arrived) == (10, 0, 10.0, 20, 0)


def test_quantiles_are_values_that_occurred_and_runs_without_one_are_left_out(
    tmp_path: Path,
) -> None:
    rows = [replace(FLOWN, run=n, delay_max_s=float(n) if n else None) for n in range(10)]
    (cell, _) = summaries(written(tmp_path, rows))
    least, middle, most = (estimate.value for estimate in cell.quantiles["delay_max_s"])
    assert (least, middle, most) == (1.0, 5.0, 9.0)


def test_failed_runs_are_counted_and_nothing_else_is_made_of_them(tmp_path: Path) -> None:
    rows = [replace(FLOWN, run=n, lost=True) for n in range(4)]
    rows += [RunRow(cell=0, run=n, seed=1, error="no") for n in range(4, 10)]
    cell, nothing = summaries(written(tmp_path, rows))
    assert (cell.runs, cell.failed) == (4, 6)
    assert cell.events["lost"].probability.value == 1.0
    assert (nothing.runs, nothing.events, nothing.quantiles) == (0, {}, {})


def test_weights_give_the_probability_of_encounters_as_they_occur(tmp_path: Path) -> None:
    """Half of the runs are near, all of them lost, and weigh a quarter of the others."""
    rows = [
        replace(FLOWN, run=n, lost=n < 5, weight=0.25 if n < 5 else 1.0, lost_without=n < 6)
        for n in range(10)
    ]
    (cell, _) = summaries(written(tmp_path, rows))
    lost = cell.events["lost"]
    assert lost.probability.value == pytest.approx(0.2)
    assert lost.risk_ratio.value == pytest.approx(1.25 / 2.25)
    assert (lost.induced.value, lost.unresolved.value) == pytest.approx((0.0, 0.2))
    assert cell.worth == pytest.approx(6.25**2 / (5 * 0.0625 + 5))
    assert not math.isnan(lost.probability.high)
    assert cell.quantiles == {}  # they would be of encounters as they were drawn


def test_the_level_that_stops_a_study_is_not_that_of_what_it_tells(tmp_path: Path) -> None:
    rows = [replace(FLOWN, run=n, lost=n < 3) for n in range(10)]
    stops = [{"half_width": 0.2, "level": level} for level in (0.6, 0.95)]
    told = [summaries(written(tmp_path / f"{s['level']}", rows, stop=s))[0] for s in stops]
    one, other = (cell.events["lost"].probability for cell in told)
    assert one == other
    assert one.level == 0.95


def test_a_study_that_stops_says_intervals_that_cover_at_all_looks(tmp_path: Path) -> None:
    rows = [replace(FLOWN, run=n, lost=n < 3) for n in range(10)]
    plain = summaries(written(tmp_path / "a", rows))[0].events["lost"].probability
    stopping = written(tmp_path / "b", rows, stop={"half_width": 0.2})
    looked = summaries(stopping)[0].events["lost"].probability
    assert looked.method == "anytime"
    assert looked.high - looked.low > plain.high - plain.low


@pytest.mark.parametrize("width", [60, 80, 120, 300])
def test_no_cell_of_a_table_is_cut_short(tmp_path: Path, width: int) -> None:
    rows = [replace(FLOWN, cell=cell, run=n, commands=99) for cell in (0, 1) for n in range(10)]
    results = written(tmp_path, rows)
    for table in study_tables(results.study, summaries(results), width):
        with (console := Console(width=width, file=io.StringIO())).capture() as capture:
            console.print(table)
        lines = capture.get().splitlines()
        assert "…" not in capture.get()
        assert any("0: 0% (10 runs)" in line for line in lines)
        assert max(map(len, lines)) <= width


def test_runs_in_which_nothing_is_left_to_chance_are_told(tmp_path: Path) -> None:
    rows = [
        replace(FLOWN, cell=cell, run=n, digest="same" if cell else f"{n}")
        for cell in (0, 1)
        for n in range(3)
    ]
    found = summaries(written(tmp_path, rows))
    assert [cell.alike for cell in found] == [False, True]
    assert alike_words(found).startswith("All runs of 1 cell are the same")
    assert alike_words(found[:1]) == ""
