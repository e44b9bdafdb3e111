"""Rules that can do nothing are refused or named: what is named does nothing, the rest is not."""

from __future__ import annotations

import json
import os
import shutil
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from fleet.cli import main
from fleet.cli.result import warning_lines
from fleet.config.idle_rules import Traffic, idle_rules
from fleet.config.loading import read_scenario, with_faults
from fleet.errors import LogWriteError, ScenarioError
from fleet.log.recorder import LogRecorder
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import Command, DeliveryReport, Election
from tests.conftest import Cli
from tests.faults.near_four_way import near, run
from tests.support.idle_samples import ALL, ALONE, AMONG, MUTE, TOGETHER, equipped

LOCAL = "coordination.electors='local'"

IDLE: dict[str, tuple[dict[str, Any], str, str]] = {
    "after the end": ({**ALL, "start_s": 500}, "", "begins at 500 s, and the run ends at 3 s"),
    "at the end": ({**ALL, "start_s": 3.0}, "", "begins at 3 s, and the run ends at 3 s"),
    "killed afterwards": ({"kind": "kill", "node": "1", "start_s": 9}, "", "begins at 9 s"),
    "an empty window": ({**ALL, "start_s": 1, "end_s": 1}, "", "no tick in its window from 1 s"),
    "between two ticks": (
        {"kind": "pause", "node": "1", "start_s": 1.02, "end_s": 1.08},
        "",
        "no tick in its window from 1.02 s to 1.08 s",
    ),
    "no coordinator to kill": (
        {"kind": "kill", "node": "coordinator", "start_s": 1},
        LOCAL,
        "this run has no coordinator",
    ),
    "no coordinator to hear": ({**ALL, "dst": "coordinator"}, LOCAL, "nobody sends such messages"),
    "nobody to be parted from": (
        {"kind": "partition", "groups": "1-4/coordinator"},
        LOCAL,
        "it is between none",
    ),
    "heartbeats of a UAV": (
        {**ALL, "class": "heartbeat", "src": "uav"},
        "",
        "nobody sends such messages",
    ),
    "commands of the coordinator": (
        {**ALL, "class": "cmd,ack,adsb", "src": "coordinator"},
        "",
        "nobody sends such messages",
    ),
    "a UAV and itself": ({**ALL, "src": "1", "dst": "1"}, "", "to such a receiver"),
    "coordinator and itself": ({**ALL, "src": "coordinator", "dst": "coordinator"}, "", "to such"),
}


@cache
def flown(electors: str) -> str:
    """The digest of a run without faults."""
    return run(near(3.0, None, *filter(None, [electors]))).digest


IDLE |= {case: (table, "", words) for case, (table, words) in ALONE.items()}


@pytest.mark.parametrize("case", IDLE)
def test_a_rule_that_is_said_to_do_nothing_does_nothing(case: str) -> None:
    table, electors, words = IDLE[case]
    scenario = with_faults(near(3.0, None, *filter(None, [electors])), [table], "x")
    (said,) = idle_rules(scenario)
    assert said.startswith(f"fault[0] ({table['kind']}) does nothing: ")
    assert words in said
    assert run(scenario).digest == flown(electors)


ACTS: dict[str, dict[str, Any]] = {
    "in the last tick but one": {**ALL, "start_s": 2.8},
    "one tick long": {**ALL, "start_s": 0.92, "end_s": 1.02},
    "heartbeats": {**ALL, "class": "heartbeat", "dst": "1"},
    "one way": {**ALL, "src": "1", "dst": "2"},
    "to all others": {**ALL, "src": "2", "dst": "uav"},
    "a bridge": {"kind": "partition", "groups": "1,2/2,3"},
    "one way of a bridge": {"kind": "partition", "groups": "1,2/2,3", "src": "1", "dst": "3"},
    "a kill before the end": {"kind": "kill", "node": "1", "start_s": 2.7},
}


@pytest.mark.parametrize("case", ACTS)
def test_a_rule_of_which_nothing_is_said_does_something(case: str) -> None:
    scenario = with_faults(near(3.0), [ACTS[case]], "x")
    assert idle_rules(scenario) == []
    assert run(scenario).digest != flown("")


@pytest.mark.parametrize("case", AMONG)
def test_a_rule_that_does_nothing_beside_others_is_named(case: str) -> None:
    tables, settings, words = AMONG[case]
    plain = near(3.0, None, *settings)
    scenario, without = with_faults(plain, tables, "x"), with_faults(plain, tables[:-1], "x")
    (said,) = idle_rules(scenario)
    assert said.startswith(f"fault[{len(tables) - 1}] ({tables[-1]['kind']}) does nothing: ")
    assert words in said
    assert idle_rules(without) == []
    assert run(scenario).digest == run(without).digest


@pytest.mark.parametrize("case", TOGETHER)
def test_a_rule_that_acts_beside_others_is_not_named(case: str) -> None:
    tables, settings = TOGETHER[case]
    plain = near(3.0, None, *settings)
    scenario, without = with_faults(plain, tables, "x"), with_faults(plain, tables[:-1], "x")
    assert idle_rules(scenario) == []
    assert run(scenario).digest != run(without).digest


def test_in_realtime_no_latency_is_too_short() -> None:
    scenario = with_faults(near(3.0), [{"kind": "latency", "base_s": 0.001}], "x")
    assert len(idle_rules(scenario)) == 1
    assert idle_rules(scenario, realtime=True) == []
    nothing = with_faults(near(3.0), [{"kind": "latency"}], "x")
    assert "it delays by 0 s" in idle_rules(nothing, realtime=True)[0]


MIXED = ["uav.1.equipment=no_compute", "uav.4.equipment=deaf"]


@pytest.mark.parametrize("settings", [[], [LOCAL], MIXED, [LOCAL, *MIXED], MUTE, equipped("mute")])
def test_who_sends_what_to_whom_is_as_in_a_run(settings: list[str]) -> None:
    scenario = near(6.0, None, *settings)
    traffic = Traffic(scenario)
    seen = {
        (kind, report.src[n], report.id)
        for report in run(scenario).kept
        if isinstance(report, DeliveryReport)
        for n, kind in enumerate(report.kinds)
    }
    possible = {
        (kind, a, b)
        for kind in AUDIBLE
        for a in traffic.present
        for b in traffic.present
        if a != b and traffic.sends(kind, a, b)
    }
    between = {link_message for link_message in seen if link_message[1] != link_message[2]}
    assert between <= possible
    # Not all who can elect or command come to it; what goes to all does.
    assert {
        link_message for link_message in possible if link_message[0] in ("adsb", "heartbeat")
    } <= between
    assert {kind for kind, *_ in possible} == {kind for kind, *_ in between}


@pytest.mark.parametrize(
    "table",
    [
        {"groups": "1/1"},
        {"groups": "1,2/2"},
        {"groups": "1-4/1,coordinator,2-4"},
        {"groups": "1/2", "src": "1", "dst": "1"},
        {"groups": "1/2", "src": "3"},
    ],
)
def test_a_partition_that_parts_nobody_is_refused(table: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError, match=r"x: fault\[0\].groups: .* parts nobody from anybody"):
        with_faults(near(3.0), [{"kind": "partition", **table}], "x")


def test_what_does_nothing_is_said_and_the_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    arguments = ["run", "side", "--bus", "memory", "--duration", "1", "--kill", "1@40s"]
    arguments += ["--out", "x.mcap"]
    monkeypatch.setattr(sys, "argv", ["fleet", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    words = "--kill 1@40s does nothing: it begins at 40 s, and the run ends at 1 s"
    assert f"fleet: warning: {words}\n" in capfd.readouterr().err


# a log that is not there any more


@pytest.mark.parametrize("fate", ["removed", "replaced", "folder removed", "folder replaced"])
def test_a_log_that_has_gone_is_no_log(fate: str, tmp_path: Path) -> None:
    path = tmp_path / "folder" / "x.mcap"
    path.parent.mkdir()
    recorder = LogRecorder(path, overwrite=False)
    recorder.metadata("run", {})
    if fate.startswith("folder"):
        shutil.rmtree(path.parent)
    else:
        path.unlink()
    if fate == "replaced":
        path.write_bytes(b"")
    elif fate == "folder replaced":
        path.parent.write_bytes(b"")
    with pytest.raises(LogWriteError, match=r"x\.mcap has been removed or replaced"):
        recorder.finish()


def test_a_log_that_was_renamed_on_its_way_through_a_link_is_there(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").symlink_to("a")
    with LogRecorder(tmp_path / "b" / "x.mcap", overwrite=False) as recorder:
        recorder.metadata("run", {})
    assert (tmp_path / "a" / "x.mcap").exists()


def test_a_log_into_a_device_is_where_it_was() -> None:
    with LogRecorder(Path(os.devnull), overwrite=True) as recorder:
        recorder.metadata("run", {})


def test_a_run_whose_log_is_removed_says_so(cli: Cli) -> None:
    folder = cli.folder / "logs"
    folder.mkdir()
    arguments = ["--duration", "5", "--bus", "memory", "--out", "logs/x.mcap", "--json"]
    fleet = cli.start("run", "crossing", *arguments)
    while not (folder / "x.mcap").exists():
        assert fleet.poll() is None
    shutil.rmtree(folder)
    out, err = fleet.communicate(timeout=60)
    assert fleet.returncode == 1
    assert "logs/x.mcap has been removed or replaced while the run was on" in err
    assert err.count("\n") == 1
    found = json.loads(out)
    assert (found["status"], found["log"]) == ("invalid", "")
    assert found["why"] in err
    assert found["ticks"] <= 51


# groups that nobody can lead


@pytest.mark.parametrize("electors", ["coordinator", "local"])
@pytest.mark.parametrize("equipment", ["no_compute", "deaf", "mute", "none"])
def test_that_nobody_can_lead_is_said(equipment: str, electors: str) -> None:
    settings = [*equipped(equipment), f"coordination.electors={electors}"]
    scenario = near(6.0, None, *settings)
    (line,) = warning_lines(scenario, realtime=False)
    assert line.startswith("fleet: warning: no UAV can both compute and hear")
    assert not any(isinstance(m, Election | Command) for m in run(scenario).kept)


def test_that_somebody_can_lead_is_not_said() -> None:
    assert warning_lines(near(3.0, None, *equipped("deaf")[1:]), realtime=False) == []
    alone = read_scenario(
        "four_way", ["uav=[]", "generate.kind=converge", "generate.count=1"]
    ).scenario
    assert warning_lines(alone, realtime=False) == []
