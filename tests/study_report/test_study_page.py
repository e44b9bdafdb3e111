"""The page of a study: whole, self-contained, and sensible for every kind of study."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("plotly")

import plotly.graph_objects as go

from fleet.report.page_parts import asset
from fleet.study.loading import load_study
from fleet.study.results import ResultsFolder
from fleet.study.zenoh_share import ZENOH, FlownAgain
from fleet.study_report.colours import LINE_COLOURS, RAMP
from fleet.study_report.page_tables import study_toml
from fleet.study_report.study_data import study_data_of
from fleet.study_report.study_page import study_page
from tests.support.pages import embedded, outline, own_parts
from tests.support.study_samples import (
    ELECTORS,
    HORIZON,
    LATENCY,
    LOSS,
    results_in,
    row_of,
    study_table,
)

SECTIONS = ["outcomes", "separation", "factors", "comparisons", "worst", "failures", "study"]
LEVELS = {"values": [0, 1]}
BOUNDS = {"low": 0.0, "high": 1.0}
KINDS: dict[str, tuple[dict[str, Any], set[str]]] = {
    "no factor": ({}, {"survival"}),
    "one": ({"factor": [{**LATENCY, **LEVELS}]}, {"maps", "curves", "survival"}),
    "words": ({"factor": [ELECTORS]}, {"maps", "curves", "survival"}),
    "two": (
        {"factor": [{**LATENCY, **LEVELS}, ELECTORS]},
        {"maps", "curves", "survival", "shares"},
    ),
    "four": (
        {
            "factor": [
                {**LATENCY, **LEVELS},
                {**LOSS, **LEVELS},
                ELECTORS,
                {**HORIZON, "values": [30]},
            ]
        },
        {"maps", "curves", "survival", "shares"},
    ),
    "drawn": (
        {"factor": [{**LATENCY, **BOUNDS}], "design": {"kind": "sobol", "points": 4}},
        {"points", "survival"},
    ),
    "saltelli": (
        {
            "factor": [{**LATENCY, **BOUNDS}, {**LOSS, **BOUNDS}],
            "design": {"kind": "saltelli", "points": 4},
        },
        {"points", "survival", "shares"},
    ),
    "stopping": (
        {"factor": [{**LATENCY, **LEVELS}], "stop": {"half_width": 0.1}},
        {"maps", "curves", "survival"},
    ),
}


def page_of_study(results: ResultsFolder) -> str:
    return study_page(study_data_of(results, "made_up.study"))


def words_of(page: str) -> str:
    return " ".join(" ".join(outline(page).words).split())


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_is_whole_and_needs_nothing_else(tmp_path: Path, kind: str) -> None:
    change, charts = KINDS[kind]
    results = results_in(tmp_path, study_table(6, **change), lambda cell: cell.number % 4)
    page = page_of_study(results)
    found, data = outline(page), embedded(page)
    assert [i for i in found.ids if i in SECTIONS] == SECTIONS
    assert len(found.ids) == len(set(found.ids))
    assert found.references == [f"#{section}" for section in SECTIONS]
    assert found.scripts == 3
    assert page.count("* plotly.js v") == 1
    own = own_parts(page)
    assert not re.search(r"http|@import|url\(|//cdn", own)
    assert {chart["id"] for chart in data["charts"]} == charts
    for chart in data["charts"]:
        assert f"plot-{chart['id']}" in found.ids
        assert (f"{chart['id']}-pickers" in found.ids) == bool(chart["live"])
        for content in chart["choices"] or [chart]:
            go.Figure(content["traces"], {**chart["layout"], **content["layout"]})
    assert {"lost", "nmac"} <= {outcome["id"] for outcome in data["study"]["outcomes"]}
    assert data["study"]["ramp"] == list(RAMP)
    assert data["study"]["colours"] == list(LINE_COLOURS)


def test_the_script_draws_every_kind_of_chart() -> None:
    script = asset("fleet.study_report", "study.js")
    (table,) = re.findall(r"const DRAW = \{(.*?)\};", script)
    drawn = {part.split(":")[0].strip().strip('"') for part in table.split(",")}
    assert drawn == {"maps", "curves", "points", "survival", ""}
    assert "showSendToCloud: false" in script


def test_cells_without_a_run_that_was_flown_are_named(tmp_path: Path) -> None:
    table = study_table(5, factor=[{**LATENCY, **LEVELS}, {**LOSS, **LEVELS}])
    results = ResultsFolder.create(tmp_path, load_study(table))
    rows = [row_of(cell, run, lost=run == 0) for cell in range(4) for run in range(5)]
    for n, row in enumerate(rows):
        if row.cell == 2 or (row.cell, row.run) == (0, 4):
            why = "<b>too fast</b>" if row.cell == 2 else "another"
            rows[n] = msgspec.structs.replace(row, error=why, lost=None, digest="")
    results.add(rows)
    page = page_of_study(results)
    words = words_of(page)
    assert "6 of 20 runs could not be flown" in words
    assert "Cells without a run that was flown: 2: latency 1s, loss 0%." in words
    assert re.search(r"5 1 run 0 of cell 2 <b>too fast</b> 1 1 run 4 of cell 0 another", words)
    assert "Not computed: no run was flown of 1 cell." in words
    lost = embedded(page)["study"]["outcomes"][0]
    assert lost["value"] == [25.0, 20.0, None, 20.0]
    assert "4 encounters that all cells flew" in words


def test_a_study_of_which_nothing_was_flown_says_so(tmp_path: Path) -> None:
    results = ResultsFolder.create(tmp_path, load_study(study_table(3)))
    page = page_of_study(results)
    assert "No run of this study was flown." in words_of(page)
    assert embedded(page) == {"study": None, "charts": []}
    results.add([row_of(0, 0, lost=False, error="of a test")])
    assert "1 of 1 run could not be flown" in words_of(page_of_study(results))


def test_text_of_the_study_cannot_break_the_page(tmp_path: Path) -> None:
    nasty = "</script><script>alert(1)</script><!--"
    level = [{"label": nasty}, {"label": "plain"}]
    table = study_table(3, description=nasty, factor=[{"name": "network", "level": level}])
    page = page_of_study(results_in(tmp_path, table, lambda _: 1))
    found = outline(page)
    assert found.scripts == 3
    assert nasty in "".join(found.words)


def test_what_was_flown_again_over_zenoh_is_counted(tmp_path: Path) -> None:
    results = results_in(tmp_path, study_table(8), lambda _: 1)
    assert "No run was flown again over zenoh" in words_of(page_of_study(results))
    same = [FlownAgain(0, n, f"0-{n}", f"0-{n}") for n in range(2)]
    (tmp_path / ZENOH).write_bytes(msgspec.json.encode(same))
    words = words_of(page_of_study(results))
    assert "2 of 8 runs (25.00%) flown again" in words
    assert "all came to the same digest" in words
    (tmp_path / ZENOH).write_bytes(msgspec.json.encode([*same, FlownAgain(0, 5, "0-5", "other")]))
    words = words_of(page_of_study(results))
    assert "1 came to other digests" in words
    assert "0 5 0-5 other" in words
    assert "2 of 3 runs flown again over zenoh came to the same digest" in words


def test_the_commands_that_repeat_the_worst_runs_are_on_the_page(tmp_path: Path) -> None:
    table = study_table(8, factor=[{**LATENCY, **LEVELS}])
    page = page_of_study(results_in(tmp_path, table, lambda cell: 3 * cell.number))
    assert (
        "fleet study scenario made_up.study 1 0 --out made_up-1-0.toml\n"
        "fleet run made_up-1-0.toml --out made_up-1-0.mcap\n"
        "fleet report made_up-1-0.mcap" in page
    )
    assert re.search(r"0\.500 0\.400 1: latency 1s 0 40\.0 200\.0 3\.0 NMAC", words_of(page))


def test_weights_are_said_to_be_there(tmp_path: Path) -> None:
    results = ResultsFolder.create(tmp_path, load_study(study_table(10)))
    results.add([row_of(0, r, lost=r < 2, weight=0.1 if r < 2 else 1.0) for r in range(10)])
    words = words_of(page_of_study(results))
    assert "probabilities are of encounters as they occur" in words
    assert "10 runs, worth 8" in words
    assert "Median" not in words


@pytest.mark.parametrize("kind", KINDS)
def test_the_study_on_the_page_is_the_same_study(tmp_path: Path, kind: str) -> None:
    import tomllib

    study = load_study(study_table(6, **KINDS[kind][0], faults={"loss": ["10%"]}, zenoh_share=0.5))
    del tmp_path
    assert load_study(tomllib.loads(study_toml(study))) == study
