"""A log of a fleet that has a message class more: only what depends on it is unknown."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.analysis.invariants import Verdict, check
from fleet.analysis.metrics import measure
from fleet.analysis.participant_filter import ParticipantFilter
from fleet.analysis.recorded_run import RecordedRun
from fleet.log.reader import Record
from fleet.log.store import Log
from fleet.log.unknown import UnknownClass, unknown_classes
from fleet.protocol.codec import encode, kind_of
from fleet.protocol.messages import DeliveryReport
from fleet.report.run_data import run_data_of
from tests.conftest import Cli
from tests.support import samples

EXTENDED = """
import sys
from typing import Annotated, ClassVar
from msgspec import Meta
from fleet.protocol import messages
from fleet.protocol.audience import Audience

class Battery(messages.Message, frozen=True, forbid_unknown_fields=True, gc=False):
    charge: Annotated[float, Meta(ge=0.0, le=1.0)]
    kind: ClassVar[str] = "battery"
    audience: ClassVar[Audience] = Audience.UAVS
    rank: ClassVar[int] = 60

messages.Battery = Battery  # before anything makes a list of the classes

import fleet
from fleet.agents.agent import Agent

plain = Agent.step

def step(self, now_ns, inbox):
    telling = self._due(now_ns, 1_000_000_000)
    out = plain(self, now_ns, inbox)
    return [*out, Battery(self.id, self._next(Battery), now_ns, 0.5)] if telling else out

Agent.step = step
scenario = fleet.load_scenario("four_way", {"duration_s": 45}, {"rate": sys.argv[2:]})
run = fleet.run(scenario, out=sys.argv[1])
print(fleet.check(run).overall)
"""
PLAIN, SLOW = "plain.mcap", "slow.mcap"
DEPENDENT = ("received was sent", "nothing lost silently", "fault plan applied")
WHY = "message class 'battery' is not known here"
MESSAGES = 4 * 46
"""One of each UAV in each second from 0 to 45."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of the extended fleet; what it says itself of them is that they are valid."""
    path = tmp_path_factory.mktemp("extended")
    (path / "extended.py").write_text(EXTENDED)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    for log, *faults in ((PLAIN,), (SLOW, "20kbit")):
        done = subprocess.run(
            [sys.executable, "extended.py", log, *faults],
            cwd=path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.stdout, done.returncode) == ("valid\n", 0), done.stderr
    return path


@pytest.mark.parametrize("log", [PLAIN, SLOW])
def test_unknown_is_what_depends_on_it(folder: Path, log: str) -> None:
    found = check(folder / log)
    assert (found.overall, found.why, found.broken) == (Verdict.UNKNOWN, WHY, ())
    examined = {name for name in DEPENDENT if found.of(name).examined}
    assert {f.name for f in found.findings if f.why == WHY} == examined
    assert "received was sent" in examined
    valid = ("flown as obeyed", "answers have commands", "record intact", "sent by its issuer")
    assert [found.of(name).verdict for name in valid] == [Verdict.VALID] * 4


def test_what_is_wrong_stays_wrong(folder: Path) -> None:
    run = RecordedRun.of_log(folder / PLAIN).in_memory()
    records = list(run.records)
    lost = next(n for n, r in enumerate(records) if r.topic == "2/adsb/0" and r.sent_ns > 10**10)
    found = check(dataclasses.replace(run, records=records[:lost] + records[lost + 1 :]))
    assert found.overall is Verdict.INVALID
    assert {"received was sent", "sent by its issuer", "record intact"} <= {*found.broken}


def test_it_is_named_with_its_messages(folder: Path) -> None:
    battery = (UnknownClass("battery", MESSAGES, 4),)
    run, log = RecordedRun.of_log(folder / PLAIN), Log(folder / PLAIN)
    assert run.unknown == log.unknown == battery
    assert "1/battery" not in log.topics
    assert not run.foreign


def test_the_rest_is_measured_and_drawn_as_it_is(folder: Path) -> None:
    run = RecordedRun.of_log(folder / PLAIN)
    measured = {row.kind: row for row in measure(run).classes}
    assert "battery" not in measured
    assert measured["adsb"].delivery_ratio == 1.0
    assert measured["adsb"].delivered > 3000
    assert run_data_of(run).damage == ""


def test_commands_name_it(folder: Path, cli: Cli) -> None:
    path, words = str(folder / PLAIN), f"{MESSAGES} messages of class battery, not known here"
    checked = cli.run("check", path)
    assert checked.returncode == 2
    assert checked.stderr == f"fleet: {path}: ignored: {words}\n"
    assert checked.stdout.splitlines()[-1] == f"{path}: unknown: {WHY}"
    assert cli.run("metrics", path).stderr == checked.stderr
    lines = cli.run("info", path).stdout.splitlines()
    (row,) = [line.strip("│ ").split() for line in lines if "battery" in line]
    assert row == ["battery", "(not", "known", "here)", "│", str(MESSAGES), "│", "4"]
    told = json.loads(cli.run("info", path, "--json").stdout)
    assert told["unknown"] == [{"kind": "battery", "messages": MESSAGES, "issuers": 4}]
    assert words in cli.run("cat", path, "--topics", "1/battery").stderr


def test_a_report_loses_its_entries_of_the_class_and_no_others() -> None:
    report = DeliveryReport(
        1,
        0,
        10**9,
        src=(2, 2, 2),
        kinds=("adsb", "battery", "battery"),
        seqs=(4, 5, 6),
        sent_ns=(7, 8, 9),
        delivered_ns=(10, 11, 12),
        fates=("received", "loss", "received"),
        transit_ns=(13, 14, 15),
        delay_ns=(16, 17, 18),
        slip_ns=(19, 20, 21),
    )
    record = Record("1/delivery", encode(report), 0, 10**9, 10**9)
    scenario = samples.head_on()
    assert ParticipantFilter(scenario).decode(record) is None
    found = ParticipantFilter(scenario, frozenset({"battery"})).decode(record)
    assert isinstance(found, DeliveryReport)
    assert (found.src, found.kinds, found.seqs, found.sent_ns) == ((2,), ("adsb",), (4,), (7,))
    assert (found.transit_ns, found.delay_ns, found.slip_ns) == ((13,), (16,), (19,))


def test_classes_are_told_by_their_topics() -> None:
    topics = {"1/battery": 3, "2/battery": 4, "1/wind/3": 1, "weather": 2}
    assert unknown_classes(topics) == (
        UnknownClass("battery", 7, 2),
        UnknownClass("weather", 2, 1),
        UnknownClass("wind", 1, 1),
    )
    assert kind_of("weather") == ""
