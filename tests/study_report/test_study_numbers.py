"""What is drawn of a study, against numbers that were computed otherwise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy import stats

from fleet.errors import StudyError
from fleet.report.plot import unpacked
from fleet.study.design import cells_of
from fleet.study.loading import load_study
from fleet.study.results import ResultsFolder
from fleet.study.statistics.sensitivity import saltelli_points
from fleet.study.study_file import Study
from fleet.study.summary import CellSummary
from fleet.study_report.chart_data import chart_data_of
from fleet.study_report.comparisons import cell_comparisons
from fleet.study_report.factor_shares import TOGETHER, factor_shares
from fleet.study_report.outcomes import outcomes_of
from fleet.study_report.study_data import (
    RUN_COLUMNS,
    ReportedCell,
    ReportedFactor,
    StudyData,
    study_data_of,
)
from fleet.study_report.worst_runs import repeat_commands, worst_runs
from tests.support.study_samples import (
    ELECTORS,
    HORIZON,
    LATENCY,
    LOSS,
    results_in,
    row_of,
    study_table,
)

GRID: list[dict[str, Any]] = [{**LATENCY, "values": [0, 0.5, 1]}, {**LOSS, "values": [0, 30]}]
LOST = (0, 2, 5, 9, 20, 40)
"""Runs of 40 that are lost in each cell of the grid."""


def made(folder: Path, table: dict[str, Any], lost: Callable[[Any], int], **more: Any) -> StudyData:
    return study_data_of(results_in(folder, table, lost, **more), "made_up.study")


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> StudyData:
    folder = tmp_path_factory.mktemp("grid")
    return made(folder, study_table(factor=GRID), lambda cell: LOST[cell.number])


def column(data: StudyData, outcome: str) -> dict[str, Any]:
    (found,) = [o for o in chart_data_of(data)["outcomes"] if o["id"] == outcome]
    return dict(found)


def exact(events: int, runs: int) -> tuple[float, float]:
    found = stats.binomtest(events, runs).proportion_ci(0.95, "exact")
    return 100.0 * found.low, 100.0 * found.high


def test_probabilities_and_their_intervals_are_those_of_the_rows(grid: StudyData) -> None:
    lost = column(grid, "lost")
    assert lost["value"] == pytest.approx([100.0 * n / 40 for n in LOST])
    bounds = np.array([exact(n, 40) for n in LOST])
    assert np.column_stack([lost["low"], lost["high"]]) == pytest.approx(bounds)
    assert lost["without"]["value"] == [50.0] * 6
    assert lost["same_without"] == "50.0 % (33.8 to 66.2)"
    assert lost["text"][:3] == ["0 %", "5.0 %", "12.5 %"]
    assert lost["interval"][1] == "0.61 to 16.9"
    # Of the lost runs every second one would have been lost anyhow, the first of them is an NMAC.
    assert column(grid, "induced")["value"] == [100.0 * (n // 2) / 40 for n in LOST]
    assert column(grid, "unresolved")["value"] == [100.0 * ((n + 1) // 2) / 40 for n in LOST]
    assert column(grid, "nmac")["value"] == [0.0] + [2.5] * 5
    assert column(grid, "nmac")["without"]["value"] == [10.0] * 6


def test_medians_are_those_of_the_rows(grid: StudyData) -> None:
    assert column(grid, "delay")["value"] == [5.0 + 19.0] * 6
    assert column(grid, "path_deviation")["value"] == [100.0 + 190.0] * 6
    nearest = column(grid, "least_separation")
    for cell, value in zip(grid.cells, nearest["value"], strict=True):
        assert value == sorted(cell.flown["least_separation"])[19]
    low, high = stats.binom.ppf([0.025, 0.975], 40, 0.5)
    rising = 5.0 + np.arange(40)
    delay = column(grid, "delay")
    assert delay["low"][0] <= rising[int(low)]
    assert delay["high"][0] >= rising[int(high) - 1]


def test_colours_go_from_zero_to_the_greatest_probability(grid: StudyData) -> None:
    assert column(grid, "lost")["bounds"] == (0.0, 100.0)
    assert column(grid, "delay")["bounds"] == (24.0, 25.0)  # where all are the same
    low, high = column(grid, "least_separation")["bounds"]
    assert (low, high) == (pytest.approx(0.519), pytest.approx(1.29))


def test_cells_are_where_their_levels_are(grid: StudyData) -> None:
    data = chart_data_of(grid)
    assert [c["at"] for c in data["cells"]] == [(i, j) for i in range(3) for j in range(2)]
    assert data["cells"][3]["name"] == "3: latency 0.5s, loss 30%"
    assert [f["labels"] for f in data["factors"]] == [("0s", "0.5s", "1s"), ("0%", "30%")]
    assert [f["numbers"] for f in data["factors"]] == [(0.0, 0.5, 1.0), (0.0, 30.0)]
    assert [f["title"] for f in data["factors"]] == ["latency (s)", "loss (%)"]


def test_levels_in_words_have_no_numbers(tmp_path: Path) -> None:
    data = made(tmp_path, study_table(factor=[ELECTORS]), lambda _: 3)
    (factor,) = chart_data_of(data)["factors"]
    assert factor["labels"] == ("coordinator", "local")
    assert factor["numbers"] is None


def test_survival_counts_the_runs_that_keep_so_much(grid: StudyData) -> None:
    data = chart_data_of(grid)["survival"]
    reach = stats.kstwo.isf(0.05, 40)
    for cell, lost in zip(grid.cells, LOST, strict=True):
        curve = {k: unpacked(v) for k, v in data["curves"][str(cell.cell.number)].items()}
        least = cell.flown["least_separation"].astype(np.float32)
        for at, share in zip(curve["at"], curve["share"], strict=True):
            assert share == pytest.approx(np.mean(least >= at), abs=1e-6)
        assert curve["share"][list(curve["at"]).index(1.0)] == pytest.approx(1.0 - lost / 40)
        assert curve["low"] == pytest.approx(np.maximum(curve["share"] - reach, 0.0), abs=1e-6)
        assert curve["high"] == pytest.approx(np.minimum(curve["share"] + reach, 1.0), abs=1e-6)
    assert data["same_without"]
    assert list(data["without"]) == ["0"]
    assert 2.0 <= data["end"] <= 8.0


def test_cells_are_compared_on_common_encounters_with_holms_correction(grid: StudyData) -> None:
    found = cell_comparisons(grid, "lost")
    assert found is not None
    assert found.encounters == 40
    p_values = [stats.binomtest(0, n, 0.5).pvalue for n in LOST[1:]]
    order, holm, most = np.argsort(p_values), {}, 0.0
    for rank, place in enumerate(order):
        most = max(most, min(1.0, (len(p_values) - rank) * p_values[place]))
        holm[place] = most
    for n, (cell, test) in enumerate(found.tests):
        assert cell.cell.number == n + 1
        assert (test.counts.first_only, test.counts.second_only) == (0, LOST[n + 1])
        assert test.p_value == pytest.approx(p_values[n])
        assert test.adjusted_p_value == pytest.approx(holm[n])


def test_the_cell_to_compare_with_can_be_chosen(grid: StudyData) -> None:
    found = cell_comparisons(grid, "lost", 4)
    assert found is not None
    assert [cell.cell.number for cell, _ in found.tests] == [0, 1, 2, 3, 5]
    assert found.tests[0][1].counts.first_only == 20
    with pytest.raises(StudyError, match="there is no cell 6; they are 0 to 5"):
        cell_comparisons(grid, "lost", 6)


def test_encounters_that_failed_somewhere_are_not_compared(tmp_path: Path) -> None:
    table = study_table(10, factor=[{**LATENCY, "values": [0, 1]}])
    results = ResultsFolder.create(tmp_path, load_study(table))
    results.add([row_of(0, run, lost=False) for run in range(10)])
    rows = [row_of(1, run, lost=run > 6) for run in range(10)]
    rows[8] = msgspec.structs.replace(rows[8], error="of a test", lost=None)
    results.add(rows)
    found = cell_comparisons(study_data_of(results, "x"), "lost")
    assert found is not None
    (test,) = [test for _, test in found.tests]
    assert (found.encounters, test.counts.second_only, test.counts.neither) == (9, 2, 7)


def test_main_effects_are_shares_of_the_variance_of_the_means(tmp_path: Path) -> None:
    """Path deviations add up: latency 0, 1 and 2, loss 0 and 4; both without any noise."""
    results = ResultsFolder.create(tmp_path, load_study(study_table(5, factor=GRID)))
    results.add(
        [
            row_of(c.number, run, lost=False, path_deviation_max_m=float(sum(_steps(c))))
            for c in results.cells
            for run in range(5)
        ]
    )
    found = factor_shares(study_data_of(results, "x"))
    (shares,) = [s for s in found.shares if s.outcome == "greatest path deviation"]
    of_latency, of_loss = np.var([0, 1, 2]), np.var([0, 4])
    expected = of_latency / (of_latency + of_loss)
    assert found.kind == "grid"
    assert shares.first["latency"].value == pytest.approx(expected)
    assert shares.first["loss"].value == pytest.approx(1.0 - expected)
    assert shares.first[TOGETHER].value == pytest.approx(0.0, abs=1e-9)


def _steps(cell: Any) -> tuple[float, float]:
    latency, loss = (level.number for level in cell.levels)
    return 2.0 * latency, loss / 7.5


def test_sobol_indices_come_of_a_saltelli_design() -> None:
    """Delays are 3 x + y of factors that go from 0 to 1: shares 0.9 and 0.1 of the variance."""
    factor = [{**LATENCY, "low": 0.0, "high": 1.0}, {**HORIZON, "low": 30.0, "high": 31.0}]
    table = study_table(2, factor=factor, design={"kind": "saltelli", "points": 128})
    study = msgspec.convert(table, Study)  # not checked, which would try each of 512 cells
    cells = []
    for cell in cells_of(study):
        x, y = (level.number or 0.0 for level in cell.levels)
        flown: dict[str, Any] = {name: np.full(2, 0.5) for name in RUN_COLUMNS}
        flown["delay_max_s"] = 3.0 * x + y - 30.0 + np.array([-1.0, 1.0])  # which average out
        summary = CellSummary(cell, 2, 0, 2.0, {}, {}, 0, 0, alike=False)
        cells.append(ReportedCell(f"{cell.number}", summary, flown, ()))
    factors = tuple(ReportedFactor(f.name, f.unit, (), ()) for f in study.factor)
    found = factor_shares(StudyData(study, "x", factors, tuple(cells), (), {}, ()))
    (shares,) = found.shares
    assert (found.kind, shares.outcome) == ("sobol", "greatest delay")
    for name, share in (("latency", 0.9), ("horizon", 0.1)):
        assert shares.first[name].value == pytest.approx(share, abs=0.03)
        assert shares.total[name].value == pytest.approx(share, abs=0.03)


def test_the_cells_of_a_saltelli_design_are_the_rows_that_indices_need() -> None:
    factor = [{**LATENCY, "low": 1.0, "high": 3.0}, {**LOSS, "low": 0.0, "high": 50.0}]
    table = study_table(seed=4, factor=factor, design={"kind": "saltelli", "points": 8})
    numbers = [[level.number for level in cell.levels] for cell in cells_of(load_study(table))]
    assert np.array(numbers) == pytest.approx(saltelli_points(2, 8, 4) * [2.0, 50.0] + [1.0, 0.0])


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({}, "The study has no factors."),
        ({"factor": [ELECTORS]}, "All that cells differ by is due to electors."),
        (
            {
                "factor": [{**LATENCY, "low": 0, "high": 1}],
                "design": {"kind": "sobol", "points": 4},
            },
            "Needs a grid, or the design saltelli",
        ),
    ],
)
def test_where_no_shares_are_known_it_is_said_why(
    tmp_path: Path, change: dict[str, Any], why: str
) -> None:
    found = factor_shares(made(tmp_path, study_table(4, **change), lambda _: 1))
    assert found.shares == ()
    assert found.why.startswith(why)


def test_weighted_probabilities_are_of_encounters_as_they_occur(tmp_path: Path) -> None:
    """Lost are 2 of 10 runs, which weigh 0.1 each; the others weigh 1."""
    results = ResultsFolder.create(tmp_path, load_study(study_table(10)))
    results.add([row_of(0, r, lost=r < 2, weight=0.1 if r < 2 else 1.0) for r in range(10)])
    data = study_data_of(results, "x")
    assert data.weighted
    assert column(data, "lost")["value"] == pytest.approx([100.0 * 0.2 / 8.2])
    assert [o.id for o in outcomes_of(data)] == ["lost", "nmac", "induced", "unresolved"]
    curve = {k: unpacked(v) for k, v in chart_data_of(data)["survival"]["curves"]["0"].items()}
    assert curve["share"][list(curve["at"]).index(1.0)] == pytest.approx(8.0 / 8.2)
    assert factor_shares(data).shares == ()


def test_the_worst_runs_are_the_nearest_of_all_cells(grid: StudyData) -> None:
    found = worst_runs(grid)
    assert len(found) == 20
    least = [run.least_separation for run in found]
    everything = np.concatenate([cell.flown["least_separation"] for cell in grid.cells])
    assert least == sorted(everything)[:20]
    assert [(r.cell.cell.number, r.run) for r in found[:6]] == [
        *((c, 0) for c in range(1, 6)),
        (1, 1),
    ]
    assert (found[0].lost, found[0].nmac, found[5].nmac) == (True, True, False)


def test_a_run_is_repeated_by_three_commands(grid: StudyData) -> None:
    assert repeat_commands(grid, 4, 17) == [
        "fleet study scenario made_up.study 4 17 --out made_up-4-17.toml",
        "fleet run made_up-4-17.toml --out made_up-4-17.mcap",
        "fleet report made_up-4-17.mcap",
    ]
    elsewhere = dataclasses.replace(grid, said="my results/x.study")
    assert "'my results/x.study' 4 17" in repeat_commands(elsewhere, 4, 17)[0]


def test_of_many_cells_that_make_no_grid_a_few_are_drawn(tmp_path: Path) -> None:
    factor = [{**LATENCY, "low": 0.0, "high": 1.0}]
    design = {"kind": "latin_hypercube", "points": 20}
    data = made(tmp_path, study_table(20, factor=factor, design=design), lambda c: c.number)
    drawn = chart_data_of(data)
    assert drawn["survival"]["chosen"] == (0, 4, 9, 14, 19)
    assert sorted(map(int, drawn["survival"]["curves"])) == [0, 4, 9, 14, 19]
    assert [c["at"] for c in drawn["cells"]] == [()] * 20
    numbers = [c["numbers"][0] for c in drawn["cells"]]
    assert numbers == [cell.levels[0].number for cell in cells_of(data.study)]


def test_runs_in_which_nobody_meets_keep_any_separation(tmp_path: Path) -> None:
    data = made(tmp_path, study_table(4), lambda _: 0, least_separation=None, least_without=None)
    curve = chart_data_of(data)["survival"]["curves"]["0"]
    assert unpacked(curve["share"]).tolist() == [1.0] * len(unpacked(curve["at"]))
    assert worst_runs(data) == []
