"""No two commands differ on a run: whatever several of them tell is the same number."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.words import separation_text
from fleet.cli import main
from fleet.report.curves import pair_curves, pairs_lost
from fleet.report.page import tiles_of
from fleet.report.run_data import run_data_of

Told = dict[str, Any]

TWO = """
name = "two"
duration_s = 22.0
resolver = "none"
[zone]
radius_m = {radius_m}
half_height_m = 25.0
[[uav]]
id = 1
position_ned_m = [0.0, -501.3, -300.0]
heading_deg = 90.0
waypoints_ned_m = [[0.0, 2000.0, -300.0]]
[[uav]]
id = 2
position_ned_m = [{offset_m}, 501.3, -300.0]
heading_deg = -90.0
waypoints_ned_m = [[{offset_m}, -2000.0, -300.0]]
"""
"""They close at 50 m/s and pass after 1002.6 / 50 s = 20.052 s, between two ticks."""


THREE = """
name = "three"
duration_s = 14.0
[[uav]]
id = 1
position_ned_m = [-600.0, 0.0, -300.0]
heading_deg = 0.0
waypoints_ned_m = [[-350.0, 0.0, -300.0], [-280.0, 0.0, -300.0]]
[[uav]]
id = 2
position_ned_m = [600.0, 0.0, -300.0]
heading_deg = 180.0
waypoints_ned_m = [[-9000.0, 0.0, -300.0]]
[[uav]]
id = 3
position_ned_m = [0.0, 700.0, -310.0]
heading_deg = -90.0
waypoints_ned_m = [[0.0, -9000.0, -300.0]]
"""
"""Three in conflict from the start."""


@pytest.fixture
def fleet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Run the command here and give what it prints; it has to succeed."""

    def run(*arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert ended.value.code == 0, err
        return out

    return run


def flown(fleet: Callable[..., str], folder: Path, text: str, *more: str) -> tuple[Path, Told]:
    """A run in memory: its log, and its result."""
    scenario, log = folder / "case.toml", folder / "case.mcap"
    scenario.write_text(text, encoding="utf-8")
    options = ("--bus", "memory", "--json", "--out", log, *more)
    return log, json.loads(fleet("run", scenario, *options))


def series(log: Path) -> Iterator[tuple[str, float, Told]]:
    """The numeric series of an export for Foxglove: topic, time in s, values."""
    with log.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic.startswith("/separation/"):
                yield channel.topic, message.log_time / 1e9, json.loads(message.data)


@pytest.mark.parametrize(("offset_m", "radius_m", "least"), [(0.0, 1.0, 0.0), (4.0, 2.5, 0.8)])
def test_two_that_pass_between_two_ticks_have_lost_separation_wherever_it_is_told(
    fleet: Callable[..., str], tmp_path: Path, offset_m: float, radius_m: float, least: float
) -> None:
    text = TWO.format(offset_m=offset_m, radius_m=radius_m)
    log, told = flown(fleet, tmp_path, text)
    assert told["least_separation"] == pytest.approx(least, abs=1e-6)
    (pair,) = told["nearest_pairs"]
    assert pair["t_s"] == pytest.approx(1002.6 / 50.0, abs=1e-6)
    assert pair["horizontal_m"] == pytest.approx(offset_m, abs=1e-6)
    assert (told["pairs"], told["pairs_lost"]) == (1, 1)
    agree(fleet, log, told)
    for command_id in (("info", log), ("metrics", log), ("compare", log, log)):
        assert separation_text(told["least_separation"]) in fleet(*command_id)


@pytest.mark.parametrize(
    "options",
    [
        ("--loss", "30%", "--latency", "300ms"),
        ("--duplicate", "40%"),
        ("--kill", "1@5s", "--pause", "2@6s+1s"),
        (
            "--set",
            "resolver=none",
            "--set",
            'fault=[{kind="kill",node="3",then="vanish",start_s=9}]',
        ),
    ],
)
def test_no_two_commands_differ_on_a_log(
    fleet: Callable[..., str], tmp_path: Path, options: tuple[str, ...]
) -> None:
    agree(fleet, *flown(fleet, tmp_path, THREE, *options))


def agree(fleet: Callable[..., str], log: Path, told: Told) -> None:
    """All that can be told of a log is what its run told."""
    info = json.loads(fleet("info", log, "--json"))["metadata"]["result"]
    metrics = json.loads(fleet("metrics", log, "--json"))
    compared = json.loads(fleet("compare", log, log, "--json"))["results"]
    sides = json.loads(fleet("repeat", log, "--set", "description=again", "--json"))
    arrivals_agree(log, told, info, metrics, compared)
    least, pairs, lost = told["least_separation"], told["nearest_pairs"], told["pairs_lost"]
    assert float(info["least_separation"]) == least
    assert int(info["pairs_lost"]) == lost
    assert int(info["elections"]) == told["elections"]
    totals = metrics["totals"]
    assert (totals["least_separation"], totals["pairs_lost"]) == (least, lost)
    assert totals["pairs"] == told["pairs"]
    assert [{name: row[name] for name in pairs[0]} for row in metrics["pairs"]] == pairs
    assert sum(row["losses"]["count"] > 0 for row in metrics["pairs"]) == lost
    assert compared["least_separation"] == [least, least]
    assert compared["pairs_lost"] == [lost, lost]
    commands_agree(told, metrics)
    delivery_agrees(told, metrics)
    for side in (sides["flown"], sides["what_if"]):
        shared = side.keys() & told.keys() - {"status", "sim_s"}
        assert {name: side[name] for name in shared} == {name: told[name] for name in shared}
    report_agrees(log, told)
    exports_agree(fleet, log, told)


ARRIVED = ("all_arrived", "arrived", "due", "not_arrived", "delay_mean_s", "delay_max_s")


def arrivals_agree(log: Path, told: Told, info: Told, metrics: Told, compared: Told) -> None:
    """Who arrived, when and how late, and who is back on its plan."""
    own = {name: told[name] for name in ARRIVED}
    assert {name: metrics["totals"][name] for name in ARRIVED} == own
    assert info["all_arrived"] == own["all_arrived"]
    assert {n: json.loads(info[n]) for n in ARRIVED[1:]} == {n: own[n] for n in ARRIVED[1:]}
    for name in set(ARRIVED) - {"not_arrived"}:
        assert compared[name] == [own[name], own[name]]
    rows = [{name: row[name] for name in told["arrivals"][0]} for row in metrics["uavs"]]
    assert rows == told["arrivals"]
    assert run_data_of(RecordedRun.of_log(log)).arrivals.totals() == {
        **own,
        "not_arrived": tuple(own["not_arrived"]),
    }


def commands_agree(told: Told, metrics: Told) -> None:
    """Elections, commands, what came of them, and how fast."""
    assert metrics["elections"]["terms"] == told["elections"]
    own, other = told["commands"], metrics["commands"]
    names = ("issued", "transmissions", "applied", "refused", "refused_by_reason")
    assert {n: own[n] for n in names} == {n: other[n] for n in names}
    spread = {n: other["latency_s"][n] for n in ("p50", "p99", "max")}
    assert own["latency_s"] == ({} if spread["p50"] is None else pytest.approx(spread))
    assert told["unresolved"] == other["unresolved"]


def delivery_agrees(told: Told, metrics: Told) -> None:
    """What was sent, came and was dropped, by class."""
    classes = {row["kind"]: row for row in metrics["classes"]}
    assert classes.keys() == told["delivery"].keys()
    for kind, own in told["delivery"].items():
        assert own["sent"] == classes[kind]["sent"]
        assert own["delivered"] == classes[kind]["delivered"] + classes[kind]["copies"]
        if own["unreported"] is not None:
            assert own["dropped"] == classes[kind]["dropped"]


def report_agrees(log: Path, told: Told) -> None:
    """What the page draws and says."""
    run_data = run_data_of(RecordedRun.of_log(log))
    curves = pair_curves(run_data, 100)
    assert [curve.least for curve in curves] == [
        p["least_separation"] for p in told["nearest_pairs"]
    ]
    for curve, pair in zip(curves, told["nearest_pairs"], strict=True):
        assert curve.ids == (pair["a"], pair["b"])
        assert curve.normalised.min() == curve.least == curve.normalised[curve.nearest]
        assert curve.times_s[curve.nearest] == pytest.approx(pair["t_s"], abs=1e-9)
        assert curve.horizontal_m[curve.nearest] == pair["horizontal_m"]
        assert curve.vertical_m[curve.nearest] == pair["vertical_m"]
    assert pairs_lost(run_data) == told["pairs_lost"]
    tiles = {what: value for value, what, _ in tiles_of(run_data, curves)}
    (least,) = [v for what, v in tiles.items() if what.startswith("least separation")]
    assert least == separation_text(told["least_separation"])
    assert tiles["pairs that lost separation"] == str(told["pairs_lost"])
    assert tiles["elections (terms)"] == str(told["elections"])


def exports_agree(fleet: Callable[..., str], log: Path, told: Told) -> None:
    """The least of the exported series."""
    exported = log.with_suffix(".foxglove.mcap")
    fleet("export", log, "--foxglove", "--out", exported)
    values: dict[str, list[tuple[float, float]]] = {}
    for topic, t_s, row in series(exported):
        values.setdefault(topic, []).append((row["normalised"], t_s))
    for pair in told["nearest_pairs"]:
        value, t_s = min(values[f"/separation/{pair['a']}-{pair['b']}"])
        assert value == pair["least_separation"]
        assert t_s == pytest.approx(pair["t_s"], abs=1e-9)
    assert min(values["/separation/least"])[0] == told["least_separation"]
