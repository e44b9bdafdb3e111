"""The page: whole, self-contained, and with the values that were logged."""

from __future__ import annotations

import dataclasses
import re
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
import pytest

from fleet.analysis.recorded_run import RecordedRun

pytest.importorskip("plotly")

import plotly.graph_objects as go

from fleet.analysis.palette import colour_of
from fleet.config.loading import read_scenario
from fleet.report.curves import pair_curves
from fleet.report.draw_airspace import PATH_M, moving, plan_chart, scene_chart
from fleet.report.draw_time import METRES, pair_chart, pairs_chart
from fleet.report.page import page_of, tiles_of
from fleet.report.plot import Chart, packed, unpacked
from fleet.report.risk import risks
from fleet.report.run_data import RunData, run_data_of
from fleet.report.scenario_text import effective_toml
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from tests.support.pages import embedded, outline, own_parts
from tests.support.report_samples import alone, clean, disturbed, log_of

SECTIONS = (
    "airspace",
    "separation",
    "commands",
    "resolution",
    "timeline",
    "messages",
    "links",
    "scenario",
)


@lru_cache
def drawn(name: str) -> str:
    """The page of a run."""
    return page_of({"clean": clean, "disturbed": disturbed, "alone": alone}[name](), "x.mcap")


@pytest.mark.parametrize("name", ["clean", "disturbed", "alone"])
def test_the_page_is_whole_and_needs_nothing_else(name: str) -> None:
    page = drawn(name)
    found = outline(page)
    assert set(SECTIONS) <= set(found.ids)
    assert len(found.ids) == len(set(found.ids))
    assert found.references == [f"#{section}" for section in SECTIONS]
    assert found.scripts == 3
    assert page.count("* plotly.js v") == 1
    own = own_parts(page)
    assert "http" not in re.sub(r"<pre>.*?</pre>", "", own, flags=re.DOTALL)
    assert "@import" not in own
    assert "url(" not in own
    assert "showSendToCloud: false" in page
    assert len(page) < 12e6


@pytest.mark.parametrize("name", ["clean", "disturbed", "alone"])
def test_every_chart_has_a_place_and_is_valid(name: str) -> None:
    page = drawn(name)
    ids, data = outline(page).ids, embedded(page)
    assert data["charts"]
    for chart in data["charts"]:
        assert f"plot-{chart['id']}" in ids
        contents = chart["choices"] or [chart]
        for content in contents[:3]:
            figure = go.Figure(content["traces"], {**chart["layout"], **content["layout"]})
            assert figure.layout.height == chart["layout"]["height"]
        if chart["choices"]:
            assert f"{chart['id']}-pick" in ids


def test_the_page_says_how_it_ended_and_what_is_missing() -> None:
    words = " ".join(outline(drawn("clean")).words)
    assert "pairs that lost separation" in words
    assert str(clean().about.digest) in words
    assert "damaged" not in words
    cut = dataclasses.replace(clean(), damage="This log is <b>cut short</b>.")
    page = page_of(cut, "cut.mcap")
    assert "<div class='damage' role='alert'>This log is &lt;b&gt;cut short" in page


def test_nobody_alone_is_told_anything() -> None:
    words = " ".join(outline(drawn("alone")).words)
    assert "There is only one UAV." in words
    assert "Nobody was told to manoeuvre." in words


def test_text_of_the_scenario_cannot_break_the_page() -> None:
    nasty = "</script><script>alert(1)</script><!--"
    scenario = msgspec.structs.replace(alone().scenario, description=nasty)
    page = page_of(dataclasses.replace(alone(), scenario=scenario), "<i>.mcap")
    found = outline(page)
    assert found.scripts == 3
    assert nasty in "".join(found.words)


# values


def test_packed_numbers_come_back() -> None:
    values = np.array([0.0, -1.5, np.nan, 270.1])
    np.testing.assert_array_equal(unpacked(packed(values)), values.astype(np.float32))
    assert list(unpacked(packed([0, 7, 300], "i2"))) == [0, 7, 300]


@pytest.mark.parametrize("chart_of", [plan_chart, scene_chart])
def test_paths_drawn_are_states_logged_in_the_colour_of_the_uav(chart_of: Any) -> None:
    run_data = clean()
    chart: Chart = chart_of(run_data)
    for flight in run_data.flights:
        (trace,) = [t for t in chart.traces if t.get("name") == f"UAV {flight.id}"]
        assert trace["line"]["color"] == colour_of(flight.index)
        logged = {tuple(p) for p in flight.ned_m[:, 1::-1].astype(np.float32).tolist()}
        shown = set(zip(unpacked(trace["x"]), unpacked(trace["y"]), strict=True))
        assert len(shown) >= 2
        assert shown <= logged


def test_zones_move_along_the_logged_path() -> None:
    run_data = clean()
    data = moving(run_data)
    for flight, uav in zip(run_data.flights, data["uavs"], strict=True):
        times = unpacked(uav["t"])
        for column, values in zip(
            "neu", (*flight.ned_m[:, :2].T, -flight.ned_m[:, 2]), strict=True
        ):
            drawn_m = np.interp(run_data.times_s, times, unpacked(uav[column]))
            assert np.abs(drawn_m - values).max() < PATH_M + 0.01


def test_distances_drawn_are_those_logged() -> None:
    run_data = clean()
    pairs = pair_curves(run_data, 10)
    chart = pair_chart(run_data, pairs, risks(run_data))
    assert len(chart.choices) == 6
    for pair, choice in zip(pairs, chart.choices, strict=True):
        x, y = unpacked(choice.traces[0]["x"]), unpacked(choice.traces[0]["y"])
        assert np.abs(np.interp(pair.times_s, x, y) - pair.horizontal_m).max() < METRES + 0.01
        assert f"{pair.least:.3f} of required" in choice.note
    shapes = chart.choices[0].layout["shapes"]
    assert [s["y0"] for s in shapes if s["line"].get("dash") == "dash"] == [400.0, 50.0]


def test_a_large_fleet_is_drawn_as_its_nearest_pairs() -> None:
    run_data = clean()
    pairs = pair_curves(run_data, 2)
    assert "the 2 nearest of 6 pairs" in pairs_chart(run_data, pairs, 6).caption


# how to repeat it


@pytest.mark.parametrize("made", [disturbed, alone])
def test_the_scenario_shown_flies_the_same_run(made: Any, tmp_path: Any) -> None:
    run_data: RunData = made()
    path = tmp_path / f"{run_data.scenario.name}.toml"
    path.write_text(effective_toml(run_data), encoding="utf-8")
    scenario = read_scenario(str(path)).scenario
    assert scenario == msgspec.structs.replace(run_data.scenario, fault=run_data.plan)
    short = msgspec.structs.replace(scenario, duration_s=min(5.0, scenario.duration_s))
    run_recorder = RunRecorder(short, None)
    for _ in run_in_memory(short, run_recorder):
        pass
    if short == scenario:
        assert run_recorder.digest == run_data.about.digest


def test_all_losses_are_counted_not_only_those_of_the_pairs_drawn() -> None:
    run_data = run_data_of(
        RecordedRun.of_log(log_of("converge", "generate.count=5", "resolver=none", "duration_s=90"))
    )
    tiles = tiles_of(run_data, pair_curves(run_data, 2))
    assert [value for value, what, _ in tiles if "lost" in what] == ["10"]
