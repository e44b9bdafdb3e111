"""Processes that are started by hand: who is waited for, for how long, and several at once."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fleet.node.join_info import JoinInfo
from fleet.simulation.join_wait import JoinWait
from fleet.simulation.several_uavs import check_flown
from fleet.simulation.tick_barrier import TickBarrier
from fleet.transport.run_search import find_plan
from fleet.transport.zenoh_bus import LOST_SIMULATION_EXIT, open_client_bus
from tests.conftest import Cli, fly
from tests.support import samples
from tests.support.replay_tools import until

FOUR = ("converge", "--set", "generate.count=4")


@pytest.fixture
def endpoint(cli: Cli) -> Iterator[str]:
    """Where a router of its own listens."""
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    yield router.stderr.readline().split()[-1]
    router.send_signal(signal.SIGTERM)
    assert router.wait(timeout=30) == 0


def test_each_who_joins_renews_the_time_and_is_counted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    barrier = TickBarrier(["1", "2", "3", "4", "coordinator"])
    wait = JoinWait("mine", barrier, 60.0)
    assert wait.over() == ""
    for name in ("1", "2", "coordinator"):
        barrier.heard(name)
    barrier.moved_s = time.monotonic() - 61.0
    assert wait.over() == ""
    assert wait.over() == ""
    told = "waiting for 3, 4 (3 of 5 here)"
    assert capsys.readouterr().err.splitlines() == [
        "fleet: run mine: waiting for 1-4, coordinator (0 of 5 here)",
        f"fleet: run mine: {told}",
    ]
    barrier.moved_s = time.monotonic() - 61.0
    assert wait.over() == f"nobody joined for 60 s: {told}"
    barrier.joining = False
    assert wait.over() == ""


def test_a_run_that_nobody_joins_ends_and_says_who_is_missing(cli: Cli, endpoint: str) -> None:
    done = cli.run("run", "head_on", "--external", "--join-timeout", "1", FLEET_CONNECT=endpoint)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert "nobody joined for 1 s: waiting for 1, 2, coordinator (0 of 3 here)" in last


def test_several_uavs_of_a_host_fly_the_same_run(cli: Cli, endpoint: str) -> None:
    where = {"FLEET_CONNECT": endpoint}
    run = cli.start("run", *FOUR, "--duration", "20", "--external", "--json", **where)
    others = [cli.start("uav", "1-3", **where), cli.start("uav", FLEET_ID="4", **where)]
    others.append(cli.start("coordinator", **where))
    out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert json.loads(out)["digest"] == fly("converge", "generate.count=4", "duration_s=20").digest
    assert [other.wait(timeout=30) for other in others] == [0, 0, 0]
    until(lambda: not any(cli.members(other) for other in others))


def test_one_that_is_killed_is_named_and_all_are_reaped(cli: Cli, endpoint: str) -> None:
    run = cli.start("run", *FOUR, "--duration", "5000", "--external", "--connect", endpoint)
    name, _ = find_plan(endpoint, "*", 30.0)
    uavs = cli.start("uav", "1-4", "--connect", endpoint)
    with open_client_bus(name, "watcher", endpoint) as watcher:
        until(lambda: all(watcher.is_alive(str(n)) for n in range(1, 5)))
    again = cli.run("uav", "2-3", "--connect", endpoint)
    assert (again.returncode, again.stderr.count("\n")) == (1, 2)
    for number in (2, 3):
        assert f"process {number}: run {name}: {number} takes part already" in again.stderr
    os.kill(_worker(cli, uavs), signal.SIGKILL)
    _, err = uavs.communicate(timeout=30)
    assert uavs.returncode == 1
    assert "ended early (killed by SIGKILL)" in err
    until(lambda: not cli.members(uavs))
    assert run.wait(timeout=30) == 1


def test_uavs_that_lose_their_simulation_or_are_interrupted_leave_nobody(
    cli: Cli, endpoint: str
) -> None:
    run = cli.start("run", *FOUR, "--external", "--connect", endpoint)
    name, _ = find_plan(endpoint, "*", 30.0)
    some = cli.start("uav", "1-2", "--connect", endpoint)
    others = cli.start("uav", "3-4", "--connect", endpoint)
    with open_client_bus(name, "watcher", endpoint) as watcher:
        until(lambda: all(watcher.is_alive(str(n)) for n in range(1, 5)))
    others.send_signal(signal.SIGTERM)
    _, err = others.communicate(timeout=30)
    assert (others.returncode, err) == (130, "fleet: interrupted\n")
    _, err = some.communicate(timeout=30)
    assert some.returncode == LOST_SIMULATION_EXIT
    assert err.count("processes 3, 4 stopped answering") == 2
    until(lambda: not cli.members(some) and not cli.members(others))
    assert run.wait(timeout=30) == 1


def test_a_run_that_nobody_has_is_told_with_those_that_are_there(cli: Cli, endpoint: str) -> None:
    run = cli.start("run", "head_on", "--external", "--connect", endpoint)
    name, _ = find_plan(endpoint, "*", 30.0)
    for role in (("uav", "1"), ("coordinator",)):
        done = cli.run(*role, "--connect", endpoint, FLEET_RUN="strange//*")
        assert done.returncode == 2
        assert done.stderr == f"fleet: no run 'strange//*' at {endpoint}; there: {name}\n"
    run.send_signal(signal.SIGINT)
    assert run.wait(timeout=30) == 130


def test_uavs_that_a_scenario_has_not_are_named() -> None:
    join_info = JoinInfo("", "mine", "lockstep", samples.head_on())
    check_flown(join_info, [1, 2])
    with pytest.raises(ValueError, match="'test' has no UAV 4, 7: it has 1-3"):
        check_flown(join_info, [3, 4, 7])


def test_a_time_to_join_without_others_is_a_contradiction(cli: Cli) -> None:
    done = cli.run("run", "head_on", "--join-timeout", "5")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "--join-timeout is for --external" in done.stderr


@pytest.mark.parametrize(
    ("listen", "said"),
    [
        ("ws/127.0.0.1:0", "does not say which port it took; choose one"),
        ("wss/127.0.0.1:0", "not supported"),
        ("quic/127.0.0.1:0", "Missing TLS private key"),
        ("odd/127.0.0.1:0", "not supported"),
        ("serial//dev/nothing", "not supported"),
    ],
)
def test_a_router_that_cannot_listen_says_so_in_a_line(cli: Cli, listen: str, said: str) -> None:
    done = cli.run("router", "--listen", listen)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


def test_a_router_listens_on_a_socket_and_over_websockets(cli: Cli, tmp_path: Path) -> None:
    for endpoint in (f"unixsock-stream/{tmp_path}/bus", f"ws/127.0.0.1:{_free_port()}"):
        router = cli.start("router", "--listen", endpoint)
        assert router.stderr is not None
        assert router.stderr.readline() == f"fleet: router listening on {endpoint}\n"
        with open_client_bus("mine", "watcher", endpoint, 10.0) as watcher:
            assert watcher.has_router()
        router.send_signal(signal.SIGTERM)
        assert router.wait(timeout=30) == 0


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _worker(cli: Cli, command: subprocess.Popen[str]) -> int:
    """The process of some UAV: the youngest that the fork server has started."""
    return cli.members(command)[-1]
