"""Real outages between hosts (network namespaces): what is waited for, and who is named.

`python -m tests.hosts` tries more of them, for longer, and prints the table of docs/hosts.md.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fleet import check, open_log
from fleet.model.conflict.contact import INCARNATION
from tests.conftest import fly
from tests.hosts.namespaces import Hosts, unable
from tests.hosts.spread_fleet import SpreadFleet

UNABLE = unable()
pytestmark = pytest.mark.skipif(bool(UNABLE), reason=UNABLE or "possible")

FOUR = ("converge", "--set", "generate.count=4")
WITHIN_S = 2.0
"""Nobody stays longer after the end."""


@pytest.fixture
def spread(tmp_path: Path) -> Iterator[SpreadFleet]:
    """UAVs 1 and 2 and the coordinator on one host, 3 and 4 on another, the rest on a third."""
    with Hosts(3, tmp_path) as hosts:
        fleet = SpreadFleet(hosts, tmp_path, 4, (1, 2))
        yield fleet
    fleet.finish()


def test_lockstep_waits_for_a_silent_link_and_comes_to_the_same_digest(
    spread: SpreadFleet,
) -> None:
    spread.fly((*FOUR, "--duration", "60"), "--speed", "15")
    spread.await_flight(5.0)
    spread.hosts.cut(2)
    time.sleep(1.5)  # an outage takes its time
    spread.hosts.heal(2)
    result = spread.result()
    assert result["status"] == "complete"
    assert result["digest"] == fly("converge", "generate.count=4", "duration_s=60").digest


def test_a_host_that_is_cut_off_is_named_whole_and_the_others_leave_at_once(
    spread: SpreadFleet,
) -> None:
    spread.fly((*FOUR, "--duration", "1000"), "--speed", "10", "--lease", "2", "--stall", "2")
    spread.await_flight(5.0)
    spread.hosts.cut(2)
    result = spread.result()
    assert result["status"] == "invalid"
    assert "3, 4" in result["why"]
    spread.await_end("1", "2", "coordinator", within_s=WITHIN_S)
    assert all(result["why"] in spread.said[name] for name in ("1", "2", "coordinator"))


def test_a_router_that_is_killed_is_named_by_everybody(spread: SpreadFleet) -> None:
    spread.fly((*FOUR, "--duration", "1000"), "--speed", "10")
    spread.await_flight(3.0)
    spread.kill(spread.router)
    result = spread.result()
    assert result["why"] == f"the zenoh router at {spread.where} has gone"
    everybody = spread.on(1) | spread.on(2)
    spread.await_end(*everybody, within_s=WITHIN_S)
    assert all(spread.where in spread.said[name] for name in everybody), spread.said


def test_in_realtime_a_silent_link_and_a_new_process_are_on_record_and_the_run_goes_on(
    spread: SpreadFleet,
) -> None:
    spread.fly((*FOUR, "--duration", "14"), "--clock", "realtime")
    spread.await_flight(2.0)
    spread.kill(spread.processes["1"])
    spread.hosts.cut(2)
    time.sleep(1.5)  # an outage takes its time
    spread.hosts.heal(2)
    spread.join("1")
    result = spread.result()
    assert result["status"] == "complete", result["why"]
    ends = {(o["id"], o["end"]) for o in result["outages"] if o["until_s"] - o["since_s"] > 1.4}
    assert ends == {(1, "restarted"), (3, "back"), (4, "back")}
    assert check(spread.log).broken == ()
    numbers = [int(n) for n in open_log(spread.log)["1/adsb/0"].seq]
    assert {n // INCARNATION for n in numbers} == {0, 1}
