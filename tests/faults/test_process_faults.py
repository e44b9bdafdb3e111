"""Processes that are killed, stopped and slowed: the same on both buses, survived, never hidden."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from fleet.config.loading import read_scenario
from fleet.log.reader import summarise
from fleet.protocol.messages import Ack, Command, Message, StateBroadcast, Truth
from fleet.protocol.topics import topic_of
from tests.conftest import Cli, truths
from tests.faults.near_four_way import UAVS, Texts, arguments, near, run
from tests.simulation.test_simulation import LONG, flying, participants, result, until
from tests.support.samples import S

# The same on both buses


BOTH: list[tuple[str, float, Texts]] = [
    ("kills", 10.0, {"kill": ["1@2s+3s", "4@3s", "3@0.1s+0.1s"]}),
    ("coordinator", 12.0, {"kill": ["coordinator@2s+5s"], "pause": ["coordinator@9s+1s"]}),
    ("pauses", 10.0, {"pause": ["2@2s+2s", "1@3s+3s", "4@9s"]}),
    ("slow", 10.0, {"slow": ["3:3@1s+4s", "coordinator:2@3s", "1:5"]}),
    (
        "all at once, on bad links",
        12.0,
        {
            "latency": ["150ms"],
            "loss": ["10%"],
            "clock-offset": ["2:300ms"],
            "kill": ["1@3s+2s", "coordinator@1s+6s", "2@4s+1s"],
            "pause": ["1@2s+5s", "*@8s+0.5s"],
            "slow": ["3:2@2s"],
        },
    ),
]


@pytest.mark.parametrize(("duration_s", "faults"), [b[1:] for b in BOTH], ids=[b[0] for b in BOTH])
def test_process_faults_give_the_same_digest_on_both_buses(
    cli: Cli, duration_s: float, faults: Texts
) -> None:
    memory = run(near(duration_s, faults))
    told = result(cli.run(*arguments(duration_s, faults)))
    assert told["digest"] == memory.digest
    assert told["messages"] == dict(sorted(memory.messages.items()))


def test_who_vanishes_does_so_on_both_buses(cli: Cli, tmp_path: Path) -> None:
    text = read_scenario("head_on").text
    path = tmp_path / "vanish.toml"
    path.write_text(f'{text}\n[[fault]]\nkind = "kill"\nnode = "2"\nthen = "vanish"\nstart_s = 3\n')
    memory = run(read_scenario(str(path), ["duration_s=6"]).scenario)
    told = result(cli.run("run", str(path), "--duration", "6", "--json"))
    assert told["digest"] == memory.digest
    assert max(m.t_ns for m in truths(memory, 2)) == 2900 * 10**6
    assert max(m.t_ns for m in truths(memory, 1)) == 6 * S
    assert memory.separation.minima()[0].t_s == 2.9  # they approach


# What is done to real processes


def start(cli: Cli, log: Path, *faults: str, speed: str = "4") -> subprocess.Popen[str]:
    """A run at a pace at which its processes can be watched; 0 is as fast as it goes."""
    pace = ("--duration", LONG if speed == "0" else "12", "--speed", speed)
    return cli.start("run", "head_on", *pace, "--out", str(log), "--json", *faults)


def state_of(pid: int) -> str:
    """State of a process, as Linux has it; empty if there is none."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii")
    except OSError:
        return ""
    return stat.rpartition(") ")[2][0]


def test_a_killed_process_is_gone_and_a_new_one_comes(cli: Cli, tmp_path: Path) -> None:
    fleet = start(cli, tmp_path / "log.mcap", "--kill", "2@3s+4s")
    until(lambda: len(participants(cli, fleet)) == 3)
    first = participants(cli, fleet)
    until(lambda: len(participants(cli, fleet)) == 2)
    (gone,) = set(first) - set(participants(cli, fleet))
    assert gone == first[-1]  # they are started in order of number
    assert state_of(gone) in ("", "Z")
    until(lambda: len(participants(cli, fleet)) == 3)
    (new,) = set(participants(cli, fleet)) - set(first)
    assert new != gone
    out, err = fleet.communicate(timeout=60)
    assert fleet.returncode == 0, err
    assert json.loads(out)["messages"]["truth"] == 2 * 121


def test_a_stopped_process_is_stopped_and_goes_on(cli: Cli, tmp_path: Path) -> None:
    fleet = start(cli, tmp_path / "log.mcap", "--pause", "1@3s+4s")
    until(lambda: len(participants(cli, fleet)) == 3)
    coordinator, one, two = participants(cli, fleet)
    until(lambda: state_of(one) == "T")
    assert "T" not in (state_of(coordinator), state_of(two))
    out, err = fleet.communicate(timeout=60)
    assert fleet.returncode == 0, err
    assert json.loads(out)["status"] == "complete"


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGSTOP])
def test_what_the_plan_does_not_say_still_makes_the_run_invalid(
    cli: Cli, tmp_path: Path, sent: signal.Signals
) -> None:
    """While another process is held by the plan, and one has been started again."""
    log = tmp_path / "log.mcap"
    faults = ("--pause", "coordinator@30s", "--kill", "2@1s+1s")
    fleet = start(cli, log, *faults, speed="0")
    until(lambda: flying(cli, fleet, log))
    until(lambda: "T" in {state_of(pid) for pid in participants(cli, fleet)})
    os.kill(participants(cli, fleet)[-1], sent)
    _, err = fleet.communicate(timeout=30)
    assert fleet.returncode == 1
    assert "INVALID" in err
    assert "process 2" in err
    assert ("killed by SIGKILL" if sent is signal.SIGKILL else "has been stopped") in err
    until(lambda: cli.members(fleet) == [])
    assert summarise(log).metadata["result"]["status"] == "invalid"


def test_the_death_of_a_process_that_the_plan_has_stopped_makes_the_run_invalid(
    cli: Cli, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    fleet = start(cli, log, "--pause", "1@10s", speed="0")
    until(lambda: flying(cli, fleet, log))
    one = participants(cli, fleet)[1]
    until(lambda: state_of(one) == "T")
    os.kill(one, signal.SIGKILL)
    _, err = fleet.communicate(timeout=30)
    assert fleet.returncode == 1
    assert "process 1 ended early (killed by SIGKILL)" in err


def test_an_interrupted_run_leaves_no_stopped_process(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    fleet = start(cli, log, "--pause", "*@10s", speed="1")
    until(lambda: len(participants(cli, fleet)) == 3)
    os.killpg(fleet.pid, signal.SIGTERM)
    _, err = fleet.communicate(timeout=30)
    assert fleet.returncode == 130, err
    until(lambda: cli.members(fleet) == [])


def test_one_that_is_started_again_too_late_to_fly_does_not_spoil_a_realtime_run(
    cli: Cli, tmp_path: Path
) -> None:
    """What it sent before it was killed is its own, and it is ready when all is over."""
    log = tmp_path / "log.mcap"
    pace = ("--clock", "realtime", "--duration", "1", "--kill", "1@0.5s+0.5s")
    short = ("--set", "tick_s=0.01")  # it is not ready by the end of the last one
    told = result(cli.run("run", "head_on", *pace, *short, "--json", "--out", str(log)))
    assert (told["status"], told["rejected"]) == ("complete", [])
    checked = json.loads(cli.run("check", str(log), "--json").stdout)["logs"][0]
    (own,) = [i for i in checked["invariants"] if i["name"] == "sent by its issuer"]
    assert own["verdict"] == "valid"


# The aircraft


def test_the_aircraft_of_a_killed_process_flies_on_straight_and_level() -> None:
    """Killed in a turn, a climb and on its plan: what it was told is not flown any more."""
    kill_s = 6.0
    flown = run(near(20.0))
    modes = {uav: truths(flown, uav)[60].mode for uav in UAVS}
    assert len(set(modes.values())) >= 3
    for uav in UAVS:
        killed = run(near(20.0, {"kill": [f"{uav}@{kill_s}s"]}))
        found = truths(killed, uav)
        assert [m.mode for m in found[60:]] == 141 * ["unmanned"]
        assert found[:60] == truths(flown, uav)[:60]
        last = found[59]
        assert all(m.heading_rad == pytest.approx(last.heading_rad) for m in found[60:])
        assert {m.commanded_climb_mps for m in found[60:]} == {0.0}
        level = found[120:]
        assert level[-1].position_ned_m[2] == pytest.approx(level[0].position_ned_m[2], abs=0.1)
        assert all(m.speed_mps == pytest.approx(25.0) for m in found)
        moved = math.dist(level[0].position_ned_m, level[-1].position_ned_m)
        assert moved == pytest.approx(25.0 * (level[-1].t_ns - level[0].t_ns) / S, rel=1e-3)
        assert not any(m.kind == "adsb" and m.id == uav and m.t_ns >= 6 * S for m in killed.kept)


def test_the_aircraft_of_a_stopped_process_holds_its_last_command() -> None:
    paused = run(near(20.0, {"pause": ["2@6s+4s"]}))
    found = truths(paused, 2)
    assert [m.mode for m in found[60:100]] == 40 * ["held"]
    before = found[59]
    told = (before.commanded_heading_rad, before.commanded_climb_mps)
    assert {(m.commanded_heading_rad, m.commanded_climb_mps) for m in found[60:100]} == {told}
    assert "held" not in {m.mode for m in (*found[:60], *found[100:])}
    own = [m for m in paused.kept if m.id == 2 and not isinstance(m, Truth)]
    assert not [m for m in own if 6 * S <= m.t_ns < 10 * S and not isinstance(m, Ack)]


@pytest.mark.parametrize(
    "faults",
    [
        {"kill": ["2@3s+4s", "2@9s+2s", "1@4s+1s"]},
        {"pause": ["2@3s+4s", "1@4s+3s"]},
        {"slow": ["*:3@2s"]},
        {"pause": ["2@3s+4s"], "kill": ["2@5s+4s"], "slow": ["2:4@8s+4s"]},
    ],
)
def test_an_aircraft_is_somewhere_in_every_tick_and_never_jumps(faults: Texts) -> None:
    run_recorder = run(near(15.0, faults))
    for uav in UAVS:
        found = truths(run_recorder, uav)
        assert [m.t_ns for m in found] == [n * 10**8 for n in range(151)]
        assert [m.seq for m in found] == list(range(151))
        for one, two in pairwise(found):
            moved = math.dist(one.position_ned_m, two.position_ned_m)
            assert moved == pytest.approx(2.5, rel=0.01)
            turned = math.remainder(two.heading_rad - one.heading_rad, math.tau)
            assert abs(turned) < 0.03


@pytest.mark.parametrize("faults", [b[2] for b in BOTH], ids=[b[0] for b in BOTH])
def test_nothing_is_ever_numbered_twice(faults: Texts) -> None:
    """Neither messages nor commands, however often a process is started again."""
    run_recorder = run(
        near(20.0, faults | {"kill": [*faults.get("kill", []), "1@12s+1s", "1@14s+1s"]})
    )
    told: dict[tuple[str, int], Message] = {}
    for message in run_recorder.kept:
        assert told.setdefault((topic_of(message), message.seq), message) is message
    issued: dict[tuple[int, int, int], Command] = {}
    for message in run_recorder.kept:
        if isinstance(message, Command):
            plain = msgspec.structs.replace(message, seq=0, t_ns=0)
            assert issued.setdefault((plain.term, plain.id, plain.number), plain) == plain


def test_a_process_that_is_started_again_knows_only_what_it_remembers() -> None:
    run_recorder = run(near(20.0, {"kill": ["2@3s+2s"]}))
    broadcasts = [m for m in run_recorder.kept if isinstance(m, StateBroadcast) and m.id == 2]
    before = [m for m in broadcasts if m.t_ns < 3 * S][-1]
    after = next(m for m in broadcasts if m.t_ns >= 5 * S)
    assert (before.manoeuvre != "", after.manoeuvre) == (True, "")
    assert before.mandate_valid
    assert not after.mandate_valid
    assert after.mandate_term == before.mandate_term > 0
    assert after.highest_term == before.highest_term > 0
    assert after.seq == 10**9
    again = [m for m in run_recorder.kept if isinstance(m, Ack) and m.id == 2 and m.t_ns >= 5 * S]
    assert any(m.accepted for m in again)
