"""That there was no room for something is told with the result, and by whoever reads the log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from fleet.analysis.recorded_run import RecordedRun
from fleet.cli.reading import opened_run
from fleet.node.gate import Gate
from fleet.node.progress import ProgressReport
from fleet.node.subscriptions import Subscriptions
from fleet.protocol.topics import FAULT, key
from fleet.simulation.fault_control import MOST_REQUESTS
from fleet.simulation.shortages import Shortages
from fleet.transport.run_search import find_plan
from fleet.transport.zenoh_bus import Bus
from fleet.transport.zenoh_session import open_client
from tests.conftest import Cli
from tests.support.replay_tools import until


class AskedBus:
    """Answers as participants do that have dropped so many messages."""

    def __init__(self, **dropped: int) -> None:
        self._dropped = dropped

    def ask_all(self, _topics: str, _timeout_s: float) -> dict[str, bytes]:
        reports = {
            name: ProgressReport(7, "computing", {}, (), count)
            for name, count in self._dropped.items()
        }
        return {f"{name}/progress": msgspec.json.encode(r) for name, r in reports.items()}


def test_what_participants_and_the_simulation_dropped_is_counted_by_place() -> None:
    shortages = Shortages()
    assert shortages.counts() == {}
    shortages.watch("sim/fault", lambda: 2)
    shortages.watch("sim/pace", lambda: 0)
    shortages.ask(cast("Bus", AskedBus(uav=0, coordinator=5, stranger=9)), ["uav", "coordinator"])
    assert shortages.counts() == {"coordinator": 5, "sim/fault": 2}


def test_what_was_dropped_of_a_cell_that_was_left_still_counts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bus: Any = type("Bus", (), {"listen": lambda *_, **__: None, "leave": lambda *_: None})()
    subscriptions = Subscriptions(bus, 1, cast("Gate", None))
    subscriptions.want(["adsb/0", "election"])
    subscriptions.intakes["adsb/0"].lacked_room = 3
    subscriptions.intakes["election"].lacked_room = 1
    subscriptions.want(["election"])
    monkeypatch.setattr(Subscriptions, "_sweep", lambda *_: None)
    subscriptions.take(None)
    assert subscriptions.intakes.keys() == {"election"}
    assert subscriptions.lacked_room == 4


def test_a_request_that_had_to_be_turned_away_is_in_the_result_and_the_log(
    cli: Cli, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    where = ("--connect", router.stderr.readline().split()[-1])
    flags = ("--duration", "2", "--out", "x.mcap", "--json")
    run = cli.start("run", "head_on", "--external", *where, *flags)
    name, _ = find_plan(where[1], "*", 30.0)
    session, answers = open_client(where[1], 30.0), list[bytes]()

    def keep(reply: Any) -> None:
        answers.append(reply.ok.payload.to_bytes())

    for _ in range(MOST_REQUESTS + 2):  # nobody has joined: they wait for the first tick
        session.get(key(name, FAULT), keep, payload=b"{}", timeout=60.0)
    until(lambda: len(answers) == 2)
    others = [cli.start(*words, *where) for words in (("uav", "1-2"), ("coordinator",))]
    out, err = run.communicate(timeout=60)
    session.close()
    assert run.returncode == 0, err
    assert json.loads(out)["lacked_room"] == {"sim/fault": 2}
    assert [process.wait(60) for process in others] == [0, 0]
    log = tmp_path / "x.mcap"
    assert RecordedRun.of_log(log).about.lacked_room == {"sim/fault": 2}
    opened_run(log)
    assert "dropped in the run for lack of room: 2 at sim/fault\n" in capsys.readouterr().err
    assert "2 at sim/fault" in cli.run("info", "x.mcap").stdout


def test_a_run_that_had_room_says_nothing_of_it(cli: Cli) -> None:
    done = cli.run("run", "head_on", "--bus", "memory", "--duration", "2", "--out", "x.mcap")
    assert "lack of room" not in done.stdout + cli.run("info", "x.mcap").stdout
