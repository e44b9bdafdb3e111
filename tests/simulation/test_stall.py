"""A run in which nothing happens any more says what is missing, from whom and where."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fleet.log.reader import summarise
from fleet.node.progress import ProgressReport
from fleet.protocol.messages import Done
from fleet.simulation.stall import Stall, owed
from tests.conftest import Cli

LOSES = """
from fleet.transport.zenoh_bus import Bus

honest = Bus.waiting, Bus.take


def waiting(bus, topic):
    return (a for a in honest[0](bus, topic) if keep(bus, a))


def take(bus, topic):
    while not keep(bus, arrival := honest[1](bus, topic)):
        pass
    return arrival


def keep(bus, arrival):
    "All but the fifth broadcast of UAV 1, in the process of UAV 2."
    if bus.name != "2" or arrival.topic != "1/adsb/0":
        return True
    bus.seen = getattr(bus, "seen", 0) + 1
    return bus.seen != 5


Bus.waiting, Bus.take = waiting, take


class Careless:
    def __init__(self, scenario):
        pass

    def resolve(self, situation):
        return []
"""

HANGS = """
import threading

class Hanging:
    def __init__(self, scenario):
        pass

    def resolve(self, situation):
        threading.Event().wait()
"""


def stalled(cli: Cli, log: Path, program: str, name: str) -> tuple[str, dict[str, str]]:
    """What a run with this resolver says on standard error, and the record in its log."""
    (cli.folder / "mine.py").write_text(program)
    more = ("--set", f"resolver=mine:{name}", "--stall", "3")
    done = cli.run("run", "head_on", *more, "--out", str(log))
    assert done.returncode == 1, done.stderr
    assert done.stderr.count("\n") == 1
    metadata = summarise(log).metadata
    assert metadata["stall"]["line"] in metadata["result"]["why"]
    return done.stderr, metadata["stall"]


def test_a_lost_message_is_named_with_its_issuer_and_its_victim(cli: Cli, tmp_path: Path) -> None:
    said, record = stalled(cli, tmp_path / "run.mcap", LOSES, "Careless")
    # Every second tick there is a broadcast: number 4 is sent in tick 8 and listed for tick 9.
    assert "nothing from 2 for 3 s: 2 lacks number 4 of 1/adsb/0 in tick 9" in said
    answer = json.loads(record["told"])["2"]
    assert (answer["tick"], answer["lacking"]) == (9, {"adsb/0": [[1, 4]]})
    assert any("intake.py" in place for place in answer["where"])
    assert json.loads(record["joined"]) == ["1", "2", "coordinator", "sim"]
    assert {"sim/clock", "*/adsb/0"} <= set(json.loads(record["hears"])["2"])
    assert json.loads(record["states"])["2"].startswith("sleeping")


def test_a_process_that_hangs_in_code_says_where(cli: Cli, tmp_path: Path) -> None:
    said, record = stalled(cli, tmp_path / "run.mcap", HANGS, "Hanging")
    assert "nothing from 1 for 3 s: 1 is computing, tick" in said
    assert any("resolve" in place for place in json.loads(record["told"])["1"]["where"])


JOINED = frozenset({"1", "2"})
WAITS = ProgressReport(7, "waiting for the clock", {}, ())


@pytest.mark.parametrize(
    ("stall", "says"),
    [
        (Stall(("2",), states={"2": "running"}), "2 has not joined (running)"),
        (Stall(("2",), joined=JOINED, states={"2": "stopped"}), "2 does not answer (stopped)"),
        (Stall(("2",), joined=JOINED), "2 does not answer (its link is silent, or it is stopped)"),
        (
            Stall(("2",), told={"2": WAITS}, joined=JOINED, hears={"2": ("*/heartbeat",)}),
            "the router does not know that 2 hears sim/clock",
        ),
        (
            Stall(("2",), told={"2": WAITS}, joined=JOINED, states={"2": "sleeping"}),
            "2 is waiting for the clock, tick 7 (sleeping)",
        ),
        (Stall((), owed={"1/truth": 2}), "the simulation lacks 2 on 1/truth"),
        (
            Stall(("1", "2", "3", "4", "5")),
            "1 is not at the router (its link is lost, or it has not joined); "
            "2 is not at the router (its link is lost, or it has not joined); "
            "3 is not at the router (its link is lost, or it has not joined); and 2 more",
        ),
    ],
)
def test_what_is_found_is_said_in_one_line(stall: Stall, says: str) -> None:
    assert stall.line() == says


def test_what_the_range_lacks_is_what_is_told_and_has_not_come() -> None:
    done = Done(1, 3, 300, 3, {"truth": 1, "adsb/0": 2}, {})
    truth = Done(1, 3, 300, 3, {}, {})  # any message does
    items = [("1/done", b"", done), ("1/adsb/0", b"", truth)]
    assert owed([*items, ("2/truth", b"", truth)]) == {"1/truth": 1, "1/adsb/0": 1}
    assert owed([*items, ("1/truth", b"", truth), ("1/adsb/0", b"", truth)]) == {}
