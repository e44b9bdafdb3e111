"""A study from file to rows: the same whatever flies it, nothing lost, every run to be repeated."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

import fleet
from fleet.config.loading import load_scenario
from fleet.errors import FailedError, MissingExtraError, StudyError
from fleet.model.conflict.risk import Required
from fleet.study.batches import Batch, BatchOrder, fly_batch
from fleet.study.design import cells_of
from fleet.study.loading import base_scenario, load_study
from fleet.study.results import ResultsFolder, open_results
from fleet.study.run_row import RunRow
from fleet.study.running import ProcessPool, StudyProgress, fly_missing
from fleet.study.scenario_of_run import scenario_of_run
from fleet.study.study_run import outcome_of
from fleet.study.summary import summaries
from fleet.study.unavoided import unavoided
from fleet.study.zenoh_share import chosen_again, flown_again
from tests.conftest import Cli

SMALL: dict[str, Any] = {
    "name": "small",
    "runs": 3,
    "seed": 5,
    "set": {"duration_s": 40.0, "tick_s": 0.2},
    "encounters": {"kind": "pairs", "cpa_s": [20, 25], "miss_m": [0, 200], "beyond_s": 10},
    "factor": [
        {"name": "latency", "fault": "latency", "unit": "s", "values": [0.0, 1.0]},
        {"name": "horizon", "key": "resolution.horizon_s", "values": [15, 40]},
    ],
}
NMAC = Required(15.24, 4.572)


def flown(folder: Path, table: dict[str, Any], jobs: int = 1) -> ResultsFolder:
    """The results of a study that was flown to its end."""
    results = ResultsFolder.create(folder, load_study(table))
    fly_missing(results, ProcessPool(jobs))
    return results


def toml_of(table: dict[str, Any]) -> str:
    import tomli_w

    return tomli_w.dumps(table)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> ResultsFolder:
    return flown(tmp_path_factory.mktemp("study") / "small", SMALL)


def test_there_is_a_row_for_each_run_of_each_cell(small: ResultsFolder) -> None:
    rows = small.table().to_pylist()
    assert [(r["cell"], r["run"]) for r in rows] == [(c, n) for c in range(4) for n in range(3)]
    assert [(r["factor.latency"], r["factor.horizon"]) for r in rows[::3]] == [
        (0.0, 15.0),
        (0.0, 40.0),
        (1.0, 15.0),
        (1.0, 40.0),
    ]
    assert not any(r["error"] for r in rows)


def test_all_cells_meet_the_same_encounters_with_the_same_draws(small: ResultsFolder) -> None:
    rows = small.table().to_pylist()
    for run in range(3):
        its = [r for r in rows if r["run"] == run]
        assert len({(r["seed"], r["least_without"], r["lost_without"]) for r in its}) == 1
        assert len({r["digest"] for r in its}) == 4
    assert len({r["least_without"] for r in rows}) == 3


def test_a_row_says_what_a_run_of_that_scenario_comes_to(small: ResultsFolder) -> None:
    study, rows = small.study, small.table().to_pylist()
    row = next(r for r in rows if (r["cell"], r["run"]) == (2, 1))
    scenario = scenario_of_run(study, base_scenario(study), small.cells[2], 1)
    run = fleet.run(scenario)
    measured = fleet.measure(
        run, volumes=(fleet.Volume("small", NMAC.horizontal_m, NMAC.vertical_m),)
    )
    assert run.digest == row["digest"]
    assert measured.pairs[0].least_separation == row["least_separation"]
    assert (measured.pairs[0].least_separation < 1.0) == row["lost"]
    delays = [uav.delay_s for uav in measured.uavs if uav.delay_s is not None]
    assert row["delay_max_s"] == (max(delays) if delays else None)
    assert row["path_deviation_max_m"] == pytest.approx(
        max(u.path_deviation_max_m for u in measured.uavs), abs=1e-6
    )


@pytest.mark.parametrize("faults", [{}, {"loss": "40%"}, {"kill": ["1@10s"]}, {"kill": "2@5s+10s"}])
def test_without_avoidance_is_what_the_resolver_none_comes_to(faults: dict[str, Any]) -> None:
    for name in ("head_on", "four_way"):
        scenario = load_scenario(name, {"duration_s": 90}, faults)
        without = load_scenario(name, {"duration_s": 90, "resolver": "none"}, faults)
        found = unavoided(scenario, NMAC)
        expected = outcome_of(without, NMAC)
        assert found.separation[0].least_separation == expected["least_separation"]
        assert sum(m.lost for m in found.separation) == expected["pairs_lost"]
        assert any(m.lost for m in found.nmac) == expected["nmac"]


def test_rows_are_the_same_in_one_process_and_in_two(small: ResultsFolder, tmp_path: Path) -> None:
    assert flown(tmp_path / "two", SMALL, jobs=2).table().equals(small.table())


def test_a_study_that_was_left_goes_on_where_it_was(small: ResultsFolder, tmp_path: Path) -> None:
    results = ResultsFolder.create(tmp_path / "left", load_study({**SMALL, "runs": 1}))
    fly_missing(results, ProcessPool(1))
    flights = []

    class Counting(ProcessPool):
        def fly(self, orders: Any) -> Any:
            for order, rows in super().fly(orders):
                flights.extend(order.batch.each())
                yield order, rows

    again = ResultsFolder.create(tmp_path / "left", load_study(SMALL))
    fly_missing(again, Counting(1))
    assert again.table().equals(small.table())
    assert sorted(flights) == [(c, n) for c in range(4) for n in range(1, 3)]
    flights.clear()
    fly_missing(again, Counting(1))
    assert flights == []


def test_results_of_another_study_are_not_mixed_in(tmp_path: Path) -> None:
    ResultsFolder.create(tmp_path, load_study(SMALL))
    with pytest.raises(StudyError, match="another study"):
        ResultsFolder.create(tmp_path, load_study({**SMALL, "seed": 6}))


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(StudyError, match=r"no study\.json, but other files \(thesis\.tex\)"):
        ResultsFolder.create(tmp_path, load_study(SMALL))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_two_commands_do_not_fly_one_study(tmp_path: Path) -> None:
    """The one that ends first would put all rows into one file, and delete those of the other."""
    one, other = (ResultsFolder.create(tmp_path, load_study(SMALL)) for _ in range(2))

    def fly_the_other(_: StudyProgress) -> None:
        with pytest.raises(StudyError, match="being flown by another command"):
            fly_missing(other, ProcessPool(1))

    fly_missing(one, ProcessPool(1), fly_the_other)
    fly_missing(other, ProcessPool(1))
    assert len(other.known()) == 12


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda table: table.drop(["lost"]), "no column lost"),
        (lambda table: table.select(["digest"]), "no column factor.latency"),
        (lambda table: table.set_column(2, "cell", [[4] * 12]), "cells that are not of study.json"),
    ],
)
def test_rows_of_something_else_are_not_taken_for_losses_that_did_not_happen(
    small: ResultsFolder, tmp_path: Path, change: Any, why: str
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    results = ResultsFolder.create(tmp_path, small.study)
    parquet.write_table(change(small.table()), tmp_path / "runs.parquet")
    with pytest.raises(StudyError, match=f"runs.parquet has {why}: it is of another study"):
        summaries(results)


def test_without_what_a_study_needs_there_is_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match="pyarrow"):
        ResultsFolder.create(tmp_path / "s.study", load_study(SMALL))
    assert not (tmp_path / "s.study").exists()


def test_a_run_that_fails_is_a_row_and_the_others_are_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(scenario: Any, nmac: Any) -> dict[str, Any]:
        if scenario.name == "small-1":
            raise ZeroDivisionError("of a test")
        return outcome_of(scenario, nmac)

    monkeypatch.setattr("fleet.study.study_run.outcome_of", failing)
    results = flown(tmp_path, SMALL)
    rows = results.table().to_pylist()
    assert [bool(r["error"]) for r in rows] == [r["run"] == 1 for r in rows]
    failed = rows[1]
    assert failed["error"] == "ZeroDivisionError: of a test"
    assert failed["lost"] is None
    assert [(s.runs, s.failed) for s in summaries(results)] == [(2, 1)] * 4


def test_a_cell_that_is_known_well_enough_gets_no_more_runs(tmp_path: Path) -> None:
    """All pairs are lost by a resolver that does nothing: 30 losses of 30 are known within 0.1."""
    table = {
        **SMALL,
        "runs": 200,
        "set": {"duration_s": 30.0, "tick_s": 0.2, "broadcast_s": 0.2},
        "factor": [{"name": "resolver", "key": "resolver", "values": ["none"]}],
        "stop": {"half_width": 0.1, "look_every": 20},
    }
    table["set"] = {"duration_s": 30.0, "tick_s": 0.2}
    table["encounters"] = {
        **SMALL["encounters"],
        "miss_m": [0, 100],
        "vertical_m": [0, 5],
        "climbing": 0,
    }
    told: list[StudyProgress] = []
    results = ResultsFolder.create(tmp_path, load_study(table))
    fly_missing(results, ProcessPool(1), told.append)
    (cell,) = summaries(results)
    assert cell.events["lost"].probability.value == 1.0
    assert cell.events["lost"].probability.half_width <= 0.1
    assert cell.runs % 20 == 0
    assert 20 <= cell.runs <= 100
    assert (told[-1].known, told[-1].total) == (cell.runs, cell.runs)


def test_a_study_that_stops_early_comes_to_the_same_rows_after_it_was_left(tmp_path: Path) -> None:
    """One loss of 20 runs is known to 0.162, of 26 to 0.13, and so one of 40 is looked for.

    Who looks at the first 20 again, and counts what was flown since, stops at 26.
    """
    table = {**SMALL, "runs": 60, "factor": [], "stop": {"half_width": 0.15, "look_every": 20}}
    study = load_study({**table, "set": {"duration_s": 600.0}})  # two runs a batch

    class ByHand(ProcessPool):
        def fly(self, orders: Any) -> Any:
            for order in orders:
                if order.batch.runs[0][0] >= self.jobs:
                    raise FailedError("of a test")
                rows = [RunRow(cell=0, run=n, seed=n, lost=n == 0) for n, _ in order.batch.runs]
                yield order, rows

    results = ResultsFolder.create(tmp_path, study)
    with pytest.raises(FailedError):
        fly_missing(results, ByHand(26))
    assert len(results.known()) == 26
    fly_missing(results, ByHand(60))
    assert len(results.known()) == 40


def test_a_batch_goes_to_other_processes_as_text() -> None:
    study = load_study(SMALL)
    order = BatchOrder(msgspec.json.encode(study), Batch(((2, (1,)),)))
    (row,) = fly_batch(msgspec.msgpack.decode(msgspec.msgpack.encode(order), type=BatchOrder))
    assert (row.cell, row.run, row.error) == (1, 2, "")
    assert isinstance(row, RunRow)


def test_designs_draw_points_within_the_bounds() -> None:
    factor = [
        {"name": "latency", "fault": "latency", "unit": "s", "low": 0.1, "high": 1.0},
        {"name": "loss", "fault": "loss", "unit": "%", "low": 0, "high": 50},
    ]
    for kind, count in (("latin_hypercube", 8), ("sobol", 8), ("saltelli", 32)):
        table = {**SMALL, "factor": factor, "design": {"kind": kind, "points": 8}}
        cells = cells_of(load_study(table))
        latencies = [cell.levels[0].number or 0.0 for cell in cells]
        assert len(cells) == count
        assert min(latencies) >= 0.1
        assert max(latencies) <= 1.0
        if kind == "latin_hypercube":  # one in each eighth
            assert sorted(int((x - 0.1) / 0.9 * 8) for x in latencies) == list(range(8))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"runs": 0}, "runs"),
        ({"name": "a b"}, "name"),
        ({"cells": 3}, "cells"),
        ({"factor": [{"name": "x", "values": [1]}]}, "either key"),
        ({"factor": [{"name": "x", "fault": "lossy", "values": [1]}]}, "lossy"),
        ({"factor": [{"name": "x", "key": "zone.radius_m", "low": 1.0, "high": 2.0}]}, "design"),
        ({"factor": [{"name": "x", "key": "zone.radius", "values": [1]}]}, r"zone\.radius"),
        ({"factor": SMALL["factor"][:1] * 2}, "twice"),
        ({"scenario": "no_such"}, "no_such"),
        ({"encounters": {"kind": "as_planned"}}, "scenario: missing"),
        ({"set": {"zone.radius_m": -1}}, r"zone\.radius_m"),
        ({"faults": {"loss": "200%"}}, "loss"),
        ({"factor": [], "design": {"kind": "saltelli", "points": 60}}, "design.points.*64"),
    ],
)
def test_a_study_that_cannot_be_is_refused_with_the_key(change: dict[str, Any], why: str) -> None:
    with pytest.raises(StudyError, match=why):
        load_study({**SMALL, **change})


def test_the_command_flies_shows_and_repeats(cli: Cli, small: ResultsFolder) -> None:
    (cli.folder / "small.toml").write_text(toml_of(SMALL), encoding="utf-8")
    run = cli.run("study", "run", "small.toml", "--jobs", "1")
    assert (run.returncode, run.stderr) == (0, "")
    assert "loss of separation" in run.stdout
    assert open_results(cli.folder / "small.study").table().equals(small.table())
    assert cli.run("study", "show", "small.study").stdout == run.stdout
    written = cli.run("study", "scenario", "small.study", "2", "1", "--out", "one.toml")
    assert (written.returncode, written.stderr) == (0, "")
    flown_again = cli.run("run", "one.toml", "--json", "--out", "one.mcap")
    row = next(r for r in small.table().to_pylist() if (r["cell"], r["run"]) == (2, 1))
    assert json.loads(flown_again.stdout)["digest"] == row["digest"]
    refused = cli.run("study", "scenario", "small.study", "9", "1")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)


def under_way(cli: Cli, table: dict[str, Any]) -> subprocess.Popen[str]:
    """The command that flies a study, once its first batch is known."""
    (cli.folder / "long.toml").write_text(toml_of(table), encoding="utf-8")
    process = cli.start("study", "run", "long.toml", "--jobs", "2")
    parts = cli.folder / "small.study" / "parts"
    while not list(parts.glob("*.parquet")):
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.02)
    return process


def test_an_interrupted_study_keeps_what_was_flown(cli: Cli) -> None:
    table = {**SMALL, "runs": 4000, "set": {"duration_s": 1.0}}
    process = under_way(cli, table)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.count("\n") == 1
    assert "the same command goes on" in err
    while cli.members(process):  # the fork server sees the end of the command by a pipe
        select.select([], [], [], 0.05)
    assert open_results(cli.folder / "small.study").known()


def test_a_killed_worker_costs_its_batch_alone_and_the_same_command_goes_on(
    cli: Cli, tmp_path_factory: pytest.TempPathFactory
) -> None:
    table = {**SMALL, "runs": 100, "set": {"duration_s": 1.0}}
    process = under_way(cli, table)
    workers = [pid for pid in cli.members(process) if pid != process.pid]
    os.kill(max(workers), signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.count("\n") == 1
    assert "run the same command again" in err
    known = open_results(cli.folder / "small.study").known()
    assert 0 < len(known) < 400
    again = cli.run("study", "run", "long.toml", "--jobs", "2")
    assert (again.returncode, again.stderr) == (0, "")
    alone = flown(tmp_path_factory.mktemp("alone"), table)
    assert open_results(cli.folder / "small.study").table().equals(alone.table())


def test_a_study_needs_no_more_than_its_extra() -> None:
    program = (
        "import sys\n"
        "sys.modules['pyarrow'] = None\n"
        "from fleet.entry import start\n"
        "sys.argv = ['fleet', 'study', 'show', '.']\n"
        "start()\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert told.returncode == 2
    assert told.stderr.count("\n") == 1


def test_a_share_of_the_runs_is_flown_again_over_zenoh_with_the_same_digests(
    tmp_path: Path,
) -> None:
    table = {**SMALL, "runs": 2, "zenoh_share": 0.4}
    study = load_study({**table, "set": {"duration_s": 10.0}})
    results = fleet.run_study(study, tmp_path, jobs=1)
    again = flown_again(tmp_path)
    assert 0 < len(again) < 8
    assert all(run.agrees and run.over_zenoh for run in again)
    # Other runs stay as chosen when there are more.
    more = ResultsFolder.create(tmp_path, msgspec.structs.replace(study, runs=3))
    fly_missing(more, ProcessPool(1))
    chosen = {(cell, run) for cell, run, _ in chosen_again(more)}
    assert {(a.cell, a.run) for a in again} == {(c, r) for c, r in chosen if r < 2}
    assert results.study.zenoh_share == 0.4
