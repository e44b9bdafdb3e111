"""`fleet repeat`: the same, changed in the log, gone another way; and what if."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.what_if import COMPARED, side_of
from fleet.cli import main
from fleet.config.loading import convert, with_settings
from fleet.config.scenario import Scenario
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.fuzz.cases import case_of
from fleet.log.reader import Record, Summary, read
from fleet.protocol import codec
from fleet.protocol.topics import CLOCK, DIGEST, FAULT, ROUND_TIME
from fleet.repetition.logged_ticks import announced_plan, scenario_flown
from fleet.simulation.active_runs import active_runs
from fleet.simulation.fault_control import FaultRequest
from fleet.simulation.result import result_json
from fleet.transport.run_search import ask
from tests.conftest import Cli
from tests.support.mutants import MUTANTS, meeting
from tests.support.replay_tools import until
from tests.support.rewriting import logged, rewritten, swap


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with an election, commands and losses; the scenario announces no change."""
    path = tmp_path_factory.mktemp("logs") / "good.mcap"
    logged(path, meeting(Loss(probability=0.2), duration_s=4.0))
    return path


@pytest.fixture
def fleet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run the command here: exit code, standard output and error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["fleet", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert isinstance(ended.value.code, int)
        return ended.value.code, *capsys.readouterr()

    return run


Fleet = Callable[..., tuple[int, str, str]]


# The same


@pytest.mark.parametrize("seed", [1, 5, 6])
def test_runs_with_faults_repeat(fleet: Fleet, tmp_path: Path, seed: int) -> None:
    table = case_of(seed)
    assert table["fault"]
    log = tmp_path / "log.mcap"
    outcome = logged(log, convert(table, "case"))
    code, out, err = fleet("repeat", log)
    assert (code, err) == (0, "")
    assert out == f"same: {outcome.ticks} ticks, digest {outcome.run_recorder.digest}\n"


def test_over_zenoh_it_is_the_same_too(cli: Cli, good: Path, tmp_path: Path) -> None:
    kept = tmp_path / "again.mcap"
    done = cli.run("repeat", str(good), "--bus", "zenoh", "--out", str(kept), "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["verdict"], told["ticks"], told["altered"]) == ("same", 41, None)
    again = [record for record in read(kept) if record.topic != ROUND_TIME]
    assert again == list(read(good))


def test_changes_that_came_while_it_flew_are_repeated(
    cli: Cli, fleet: Fleet, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    fly = ("head_on", "--duration", "10", "--speed", "4", "--out", str(log))
    run = cli.start("run", *fly, "--loss", "20%")
    assert run.stderr is not None
    assert "loss" in run.stderr.readline()
    name = run.stderr.readline().split()[1].rstrip(":")
    until(lambda: name in {r.run for r in active_runs()})
    (endpoint,) = (r.endpoint for r in active_runs() if r.run == name)
    added = FaultRequest((Latency(base_s=0.4), Kill(node="1")))
    for request in (added, FaultRequest(clear=True)):
        answer = ask(endpoint, name, FAULT, msgspec.json.encode(request), 30.0)
        assert answer is not None
        assert not msgspec.json.decode(answer)["problem"]
    _, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    original = RecordedRun.of_log(log, lenient=True)
    grants = [r for r in original.records if r.topic == CLOCK]
    assert sum(bool(announced_plan(grant)) for grant in grants) == 2
    assert [rule.name for rule in scenario_flown(original).fault] == ["loss", "latency", "kill"]
    code, out, _ = fleet("repeat", log)
    assert (code, out[:15]) == (0, "same: 101 ticks")


# Changed in the log


def test_a_change_is_told_in_words(fleet: Fleet, good: Path, tmp_path: Path) -> None:
    record = [r for r in read(good) if r.topic == "2/truth"][12]
    truth = codec.decode(record.topic, record.payload)
    payload = codec.encode(msgspec.structs.replace(truth, speed_mps=26.0))
    log = rewritten(
        good, tmp_path / "x.mcap", swap(record, dataclasses.replace(record, payload=payload))
    )
    code, out, err = fleet("repeat", log)
    assert (code, err) == (1, "")
    lines = out.splitlines()
    why = "the messages do not give the digest that was recorded with them"
    assert lines[0] == f"altered: {log}, tick 12 (1.2 s): {why}"
    assert lines[1].startswith("  2/truth  seq=12  1.200 s  differs (byte ")
    assert lines[1].endswith("  speed_mps: 26.0 -> 25.0")
    assert lines[2:] == [
        "the repetition gives the digests that were recorded: the run itself is the same"
    ]


# Another way


def test_a_run_that_goes_another_way_is_told_with_its_first_message(
    fleet: Fleet, tmp_path: Path
) -> None:
    mutant = MUTANTS["highest ID"]
    log = tmp_path / "log.mcap"
    with pytest.MonkeyPatch.context() as patch:
        mutant.patch(patch)
        logged(log, mutant.scenario)
    code, out, _ = fleet("repeat", log, "--json")
    told = json.loads(out)
    assert (code, told["verdict"], told["altered"]) == (1, "different", None)
    assert told["differs"]["tick"] == 2
    account, first = told["differs"]["messages"][:2]
    assert (account["topic"], [*account["fields"]]) == ("coordinator/done", ["digests"])
    assert (first["topic"], first["fields"]["computing"]) == ("coordinator/election", [3, 1])
    code, out, _ = fleet("repeat", log)
    assert out.splitlines()[0].startswith(f"different: {log}, tick 2 (0.2 s)")
    assert "computing: 3 -> 1" in out


def test_other_versions_are_named(fleet: Fleet, good: Path, tmp_path: Path) -> None:
    summary = Summary(good)
    for _ in read(good, summary):
        pass
    old = {**summary.metadata["run"], "fleet_version": "0.0.7"}
    scenario = json.loads(old["effective_scenario"])
    old["effective_scenario"] = json.dumps({**scenario, "seed": 3})
    code, out, _ = fleet("repeat", rewritten(good, tmp_path / "x.mcap", run=old))
    assert code == 1
    assert out.splitlines()[-1].startswith("the log was written with other versions: fleet 0.0.7")


# Not whole


@pytest.mark.parametrize("part", [0.2, 0.4, 0.6])
def test_a_log_that_is_cut_is_repeated_up_to_there(
    fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: float
) -> None:
    monkeypatch.setattr("fleet.log.recorder.CHUNK_BYTES", 1 << 12)
    log, cut = tmp_path / "log.mcap", tmp_path / "cut.mcap"
    logged(log, meeting(Loss(probability=0.2), duration_s=4.0))
    cut.write_bytes(log.read_bytes()[: round(part * log.stat().st_size)])
    whole = sum(r.topic == DIGEST for r in read(cut))
    assert 0 < whole < 41
    code, out, _ = fleet("repeat", cut)
    assert code == 0
    assert out.startswith(f"same: {whole} ticks")
    end = f"compared up to {(whole - 1) / 10:g} s, where the log ends"
    assert out.splitlines()[1] == f"{end}: it is damaged or cut short there"
    code, out, _ = fleet("repeat", cut, "--set", "description=other", "--json")
    told = json.loads(out)
    same = {k: v for k, v in told["what_if"].items() if k not in ("status", "digest")}
    assert same == {k: v for k, v in told["flown"].items() if k not in ("status", "digest")}


def test_an_invalid_run_is_repeated_up_to_its_end(fleet: Fleet, good: Path, tmp_path: Path) -> None:
    def until_s(_: int, record: Record) -> Record | None:
        return record if record.log_ns <= 1_000_000_000 else None

    log = rewritten(good, tmp_path / "x.mcap", until_s, result={"status": "invalid"})
    code, out, _ = fleet("repeat", log)
    assert code == 0
    assert out.splitlines()[0].startswith("same: 11 ticks")
    assert out.splitlines()[1] == "compared up to 1 s, where the log ends: its run was invalid"


def test_a_log_of_one_tick_is_repeated(fleet: Fleet, good: Path, tmp_path: Path) -> None:
    def first(_: int, record: Record) -> Record | None:
        return record if record.log_ns == 0 else None

    code, out, _ = fleet("repeat", rewritten(good, tmp_path / "x.mcap", first, result=None))
    assert (code, out[:13]) == (0, "same: 1 ticks")


def test_without_a_whole_tick_there_is_nothing_to_compare(
    fleet: Fleet, good: Path, tmp_path: Path
) -> None:
    log = rewritten(good, tmp_path / "x.mcap", lambda *_: None, result=None)
    code, out, err = fleet("repeat", log)
    assert (code, out) == (2, "")
    assert err == f"fleet: {log} holds no whole tick: there is nothing to compare\n"


# What if


def test_a_what_if_is_shown_beside_what_was_flown(fleet: Fleet, good: Path, tmp_path: Path) -> None:
    kept = tmp_path / "new.mcap"
    code, out, err = fleet(
        "repeat", good, "--set", "resolver=none", "--kill", "3@1s", "--out", kept, "--json"
    )
    assert (code, err) == (0, "")
    told = json.loads(out)
    assert told["flown"]["commands"]["issued"] > 0 == told["what_if"]["commands"]["issued"]
    kinds = [[rule["kind"] for rule in told[side]["fault_plan"]] for side in ("flown", "what_if")]
    assert kinds == [["loss"], ["loss", "kill"]]
    new = RecordedRun.of_log(kept, lenient=True)
    assert new.scenario.resolver == "none"
    assert new.about.digest == told["what_if"]["digest"] != told["flown"]["digest"]
    code, out, _ = fleet("repeat", good, "--set", "fault=[]")
    assert code == 0
    for words in ("Least separation", "1-2", "delivery of adsb", "elections", "digest"):
        assert words in out


@pytest.mark.parametrize(
    "scenario",
    [
        convert(case_of(12), "case"),
        meeting(Kill(node="3", start_s=2.0, then="vanish"), duration_s=4.0),
    ],
    ids=["fuzz", "vanished"],
)
def test_what_was_flown_is_counted_from_the_log_as_the_run_counted_it(
    tmp_path: Path, scenario: Scenario
) -> None:
    log = tmp_path / "log.mcap"
    run = logged(log, scenario)
    again, told = side_of(RecordedRun.of_log(log)), result_json(run)
    assert list(again.minima) == run.run_recorder.separation.minima()
    shared = {name for name in again.result if name in told}
    assert shared >= {*COMPARED, "digest", "ticks", "sim_s", "seed", "status", "clock", "uavs"}
    assert {name: again.result[name] for name in shared} == {name: told[name] for name in shared}


@pytest.mark.parametrize("seed", range(8))
def test_a_scenario_goes_through_the_settings_unchanged(seed: int) -> None:
    scenario = convert(case_of(seed), "case")
    assert with_settings(scenario, (f"seed={scenario.seed}",), "case") == scenario


def test_a_realtime_run_is_not_repeated_but_can_be_a_what_if(
    cli: Cli, fleet: Fleet, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    fly = ("--clock", "realtime", "--duration", "1", "--out", str(log))
    assert cli.run("run", "head_on", *fly).returncode == 0
    code, out, err = fleet("repeat", log)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "realtime run, which nothing repeats bit by bit" in err
    code, out, _ = fleet("repeat", log, "--loss", "50%")
    assert code == 0
    assert "due to its clock" in out


# What cannot be done


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--set", "seed"], "write key=value"),
        (["--set", "tick_s=0"], "LOG: tick_s"),
        (["--set", "resolver=nowhere:X"], "LOG: "),
        (["--loss", "200%"], "is no probability"),
        (["--kill", "99@1s"], "--kill 99@1s (node): '99' names nobody"),
        (["--out", "LOG"], "is what is read; name another"),
        (["--out", "FOLDER"], "is a directory"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    fleet: Fleet, good: Path, tmp_path: Path, arguments: list[str], says: str
) -> None:
    named = {"LOG": str(good), "FOLDER": str(tmp_path)}
    code, out, err = fleet("repeat", good, *(named.get(a, a) for a in arguments))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert says.replace("LOG", str(good)) in err


def test_ctrl_c_ends_it_with_one_line(cli: Cli, good: Path, tmp_path: Path) -> None:
    kept = tmp_path / "new.mcap"
    run = cli.start("repeat", str(good), "--set", "duration_s=80000", "--out", str(kept))
    until(lambda: kept.exists() and kept.stat().st_size > 50_000)
    os.kill(run.pid, signal.SIGINT)
    assert run.communicate(timeout=60) == ("", "fleet: interrupted\n")
    assert run.returncode == 130
