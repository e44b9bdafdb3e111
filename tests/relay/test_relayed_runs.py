"""Relays as processes, on real zenoh: programs over both media, on both clocks, good and bad."""

from __future__ import annotations

import re
import shutil
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import fleet
from fleet.analysis.recorded_run import RecordedRun
from fleet.conformance.rule import Outcome
from fleet.conformance.session import found, played
from fleet.model.words import ClockMode
from fleet.protocol.messages import Ack, Late, Truth
from fleet.security.certificates import make_certificates
from fleet.simulation import in_memory
from fleet.transport.run_search import find_plan
from tests.conftest import Cli
from tests.relay.programs import FOREIGN, example_program, relayed
from tests.support.replay_tools import until

FAULTS = {"latency": "300ms", "loss": "20%", "burst": "3", "partition": "1/2@20s+3s"}
OPTIONS = [word for name, value in FAULTS.items() for word in (f"--{name}", value)]
NODE = shutil.which("node")

PROGRAM = """
import json, math, os, subprocess, sys, time
sys.path.insert(0, sys.argv[1])
from uav import Uav
open(sys.argv[2], "w").write(str(os.getpid()))
for line in sys.stdin:
    asked, told = json.loads(line), []
    if "plan" in asked:
        flying = Uav(asked["plan"])
    elif "tick" in asked:
        told = flying.step(asked)
        if asked["tick"] == 9:
            exec(sys.argv[3])
    print(json.dumps(told), flush=True)
"""
"""The example over a pipe, which does something else in tick 9."""


@pytest.fixture
def endpoint(cli: Cli) -> str:
    """Where a router of its own listens."""
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    return router.stderr.readline().split()[-1]


def started(cli: Cli, scenario: str, endpoint: str, *options: str) -> Any:
    """A run with all but UAV 2."""
    where = ("--connect", endpoint)
    settings = ("--set", "uav.2.equipment=no_compute", "--json", "--out", "run.mcap", "--force")
    run = cli.start("run", scenario, *settings, *where, "--external", *options)
    cli.start("uav", "1", *where)
    cli.start("coordinator", *where)
    return run


def finished(cli: Cli, run: Any, *relays: Any) -> RecordedRun:
    """The run, once all have ended well."""
    for process in (run, *relays):
        _, error = process.communicate(timeout=60)
        assert process.returncode == 0, error
    return fleet.open_log(cli.folder / "run.mcap")


def in_memory_with_the_example(monkeypatch: pytest.MonkeyPatch, scenario: Any) -> RecordedRun:
    with monkeypatch.context() as patched:
        patched.setattr(in_memory, "Agent", relayed(example_program, 2))
        return fleet.run(scenario)


def example_over_zenoh(cli: Cli, endpoint: str) -> Any:
    return cli.command(sys.executable, str(FOREIGN / "uav.py"), endpoint, "2")


def pipe_program(cli: Cli, deed: str = "pass", pid_file: str = "pid") -> list[str]:
    path = cli.folder / "program.py"
    path.write_text(PROGRAM, encoding="utf-8")
    return [sys.executable, str(path), str(FOREIGN), str(cli.folder / pid_file), deed]


def test_in_lockstep_a_run_with_a_relay_is_repeatable_under_faults_and_radio_ranges(
    cli: Cli, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two flights: over zenoh, and in one process."""
    ranges = ("--set", "surveillance.range_m=3000", "--set", "coordination.range_m=9000")
    run = started(cli, "head_on", endpoint, *OPTIONS, *ranges, "--duration", "40", "--seed", "3")
    uav = example_over_zenoh(cli, endpoint)
    relay = cli.start("relay", "2", "--connect", endpoint)
    flown = finished(cli, run, relay, uav)
    assert fleet.check(flown).overall == "valid"
    settings = {"uav.2.equipment": "no_compute", "duration_s": 40, "seed": 3}
    settings |= {"surveillance.range_m": 3000, "coordination.range_m": 9000}
    scenario = fleet.load_scenario("head_on", settings, FAULTS)
    again = in_memory_with_the_example(monkeypatch, scenario)
    assert flown.digest == again.digest
    assert any(isinstance(m, Ack) and m.id == 2 and m.accepted for m in flown.messages())


@pytest.mark.skipif(NODE is None, reason="there is no Node.js here")
def test_another_language_comes_to_the_same_outcome_over_a_pipe(
    cli: Cli, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = started(cli, "head_on", endpoint, "--duration", "60")
    relay = cli.start("relay", "2", "--connect", endpoint, "--", "node", str(FOREIGN / "uav.js"))
    flown = finished(cli, run, relay)
    assert fleet.check(flown).overall == "valid"
    scenario = fleet.load_scenario("head_on", {"uav.2.equipment": "no_compute", "duration_s": 60})
    in_python = in_memory_with_the_example(monkeypatch, scenario)
    least = [fleet.measure(each).totals.least_separation for each in (flown, in_python)]
    assert least[0] == pytest.approx(least[1], abs=1e-6)
    assert min(x for x in least if x is not None) > 1.0
    answers = [
        [(m.seq, m.accepted, m.actuate_ns) for m in acks(each)] for each in (flown, in_python)
    ]
    assert answers[0] == answers[1] != []
    for one, other in zip(truths(flown), truths(in_python), strict=True):
        assert one.position_ned_m == pytest.approx(other.position_ned_m, abs=1e-6)
        assert one.mode == other.mode


def test_a_run_with_a_foreign_uav_is_repeated_where_it_joins_again(cli: Cli, endpoint: str) -> None:
    run = started(cli, "head_on", endpoint, "--duration", "5", "--seed", "3")
    uav = example_over_zenoh(cli, endpoint)
    finished(cli, run, cli.start("relay", "2", "--connect", endpoint), uav)
    alone = cli.run("repeat", "run.mcap")
    assert alone.returncode == 1
    assert "the fleet's own UAV has flown in its place here; --connect" in alone.stdout
    again = cli.start("repeat", "run.mcap", "--connect", endpoint)
    for role in (("uav", "1"), ("coordinator",), ("relay", "2")):
        cli.start(*role, "--connect", endpoint)
    example_over_zenoh(cli, endpoint)
    out, error = again.communicate(timeout=60)
    assert (again.returncode, out[:5]) == (0, "same:"), out + error


def acks(run: RecordedRun) -> list[Ack]:
    return [m for m in run.messages() if isinstance(m, Ack) and m.id == 2]


def truths(run: RecordedRun) -> list[Truth]:
    return [m for m in run.messages() if isinstance(m, Truth) and m.id == 2]


def test_by_the_wall_clock_it_flies_under_faults_and_says_when_it_is_late(
    cli: Cli, endpoint: str
) -> None:
    faults = ("--latency", "150ms", "--loss", "20%", "--burst", "3", "--partition", "1/2@1s+1s")
    run = started(cli, "head_on", endpoint, *faults, "--clock", "realtime", "--duration", "2.5")
    slow = pipe_program(cli, "time.sleep(0.3)")
    relay = cli.start("relay", "2", "--connect", endpoint, "--", *slow)
    flown = finished(cli, run, relay)
    checked = fleet.check(flown)
    assert checked.broken == ()
    assert checked.of("fault plan applied").verdict == "valid"
    assert len(truths(flown)) == 26
    assert any(isinstance(m, Late) and m.id == 2 for m in flown.messages())


@pytest.mark.parametrize("clock", ClockMode)
@pytest.mark.parametrize("language", ["python", "javascript"])
def test_relay_and_example_keep_every_rule(language: str, clock: ClockMode, cli: Cli) -> None:
    if language == "javascript" and NODE is None:
        pytest.skip("there is no Node.js here")

    def start(where: str) -> None:
        relay = ["relay", "2", "--connect", where]
        if language == "python":
            example_over_zenoh(cli, where)
        else:
            relay += ["--", "node", str(FOREIGN / "uav.js")]
        cli.start(*relay)

    endpoint = f"unixsock-stream/{cli.folder / 'bus.sock'}"
    findings = found(played(endpoint, clock, wait_s=20.0, patience_s=20.0, listening=start))
    assert [f for f in findings if f.outcome is not Outcome.KEPT] == []


CHILD = "p = subprocess.Popen(['sleep', '1000']); open(sys.argv[2], 'w').write(str(p.pid))"
DEEDS = {
    "killed": ("os.kill(os.getpid(), 9)", "its program has gone: signal 9"),
    "ended": ("sys.exit(3)", "its program has gone: exit code 3"),
    "leaves-a-child": (f"{CHILD}; sys.exit(3)", "its program has gone: exit code 3"),
    "nonsense": ("told = 'what?'", "it is no list of [class, fields], but 'what?'"),
    "no-json": ("print('hello')", "is no JSON (JSON is malformed"),
    "nan": ("told[0][1]['speed_mps'] = math.nan", "is no JSON (JSON is malformed"),
    "null": ("told[0][1]['speed_mps'] = None", "truth: Expected `float`, got `null`"),
    "wrong-class": ("told.append(['heartbeat', {}])", "'heartbeat' is no class that a UAV"),
    "half": (
        "os.write(1, b'[['); sys.exit(3)",
        "its program has gone within an answer: exit code 3",
    ),
    "flood": ("told = 'x' * 2_000_000", "its program answers more than 1048576 bytes at once"),
}


def test_what_a_bad_program_does_is_one_line_and_nobody_hangs(cli: Cli) -> None:
    def outcome(name: str) -> tuple[int, str, int]:
        relays: list[Any] = []
        program = pipe_program(cli, DEEDS[name][0], f"{name}.pid")

        def start(where: str) -> None:
            relays.append(cli.start("relay", "2", "--connect", where, "--", *program))

        endpoint = f"unixsock-stream/{cli.folder / name}.sock"
        played(endpoint, ClockMode.LOCKSTEP, wait_s=20.0, patience_s=1.0, listening=start)
        _, error = relays[0].communicate(timeout=30)
        return relays[0].returncode, error, int((cli.folder / f"{name}.pid").read_text())

    with ThreadPoolExecutor(5) as pool:
        outcomes = dict(zip(DEEDS, pool.map(outcome, DEEDS), strict=True))
    for name, (code, error, pid) in outcomes.items():
        assert DEEDS[name][1] in error, name
        assert error.startswith("fleet: UAV 2: "), name
        assert (code, error.count("\n")) == (1, 1), error
        assert gone(pid), name


def silent_in_lockstep(cli: Cli, endpoint: str) -> str:
    """What a relay says whose program is silent in a run that everybody waits in."""
    run = started(cli, "head_on", endpoint, "--stall", "1")
    program = pipe_program(cli, f"{CHILD}; time.sleep(1000)")
    relay = cli.start("relay", "2", "--connect", endpoint, "--", *program)
    _, told = run.communicate(timeout=60)
    _, error = relay.communicate(timeout=60)
    assert (run.returncode, relay.returncode) == (1, 4)
    assert "2 is waiting for the answer of its program, tick 9" in told
    assert error.count("\n") == 1
    return str(error)


def test_a_program_that_is_silent_in_lockstep_is_waited_for_up_to_the_stall_limit(
    cli: Cli, endpoint: str
) -> None:
    error = silent_in_lockstep(cli, endpoint)
    assert "2 is waiting for the answer of its program, tick 9" in error
    until(lambda: gone(int((cli.folder / "pid").read_text())))


def gone(pid: int) -> bool:
    """Whether a process has ended, reaped by its parent or not."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return True
    return stat.rpartition(")")[2].split()[0] == "Z"


def test_a_program_over_zenoh_that_is_killed_ends_the_relay_and_the_run(
    cli: Cli, endpoint: str
) -> None:
    run = started(cli, "head_on", endpoint, "--speed", "1")
    uav = example_over_zenoh(cli, endpoint)
    relay = cli.start("relay", "2", "--connect", endpoint)
    log = cli.folder / "run.mcap"
    until(lambda: log.exists() and log.stat().st_size > 4096)
    uav.kill()
    _, error = relay.communicate(timeout=60)
    assert relay.returncode == 1
    assert "fleet: UAV 2: its program has gone: nobody answers at fleet/" in error.splitlines()[-1]
    _, told = run.communicate(timeout=60)
    assert run.returncode == 1
    assert "process 2 stopped answering" in told


def test_by_the_wall_clock_a_silent_program_is_given_up_when_its_link_would_be(
    cli: Cli, endpoint: str
) -> None:
    realtime = ("--clock", "realtime", "--duration", "6", "--lease", "1")
    run = started(cli, "head_on", endpoint, *realtime)
    program = pipe_program(cli, "time.sleep(1000)")
    relay = cli.start("relay", "2", "--connect", endpoint, "--", *program)
    _, error = relay.communicate(timeout=60)
    assert (relay.returncode, error.count("\n")) == (1, 1)
    assert "UAV 2: its program has not answered for 1 s" in error
    _, told = run.communicate(timeout=60)
    assert "Traceback" not in told


def silent_until_the_run_is_over(cli: Cli, endpoint: str) -> str:
    """What a relay says whose program is silent in a run that is over before it is given up."""
    started(cli, "head_on", endpoint, "--clock", "realtime", "--duration", "2")
    program = pipe_program(cli, "time.sleep(1000)")
    relay = cli.start("relay", "2", "--connect", endpoint, "--", *program)
    _, error = relay.communicate(timeout=60)
    assert (relay.returncode, error.count("\n")) == (4, 1), error
    return str(error)


def test_by_the_wall_clock_a_program_that_is_silent_to_the_end_is_told_of(
    cli: Cli, endpoint: str
) -> None:
    error = silent_until_the_run_is_over(cli, endpoint)
    ends = (
        r"fleet: process 2 ends: sim has gone; its program had not answered tick 9 for \d+\.\d s\n"
    )
    assert re.fullmatch(ends, error)


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux does it")
def test_a_killed_relay_takes_its_program_with_it(cli: Cli, endpoint: str) -> None:
    started(cli, "head_on", endpoint)
    program = pipe_program(cli, "open('asleep', 'w').close(); time.sleep(1000)")
    relay = cli.start("relay", "2", "--connect", endpoint, "--", *program)
    until((cli.folder / "asleep").exists)
    relay.send_signal(signal.SIGKILL)
    until(lambda: gone(int((cli.folder / "pid").read_text())))


def test_nobody_to_ask_is_one_line(cli: Cli, endpoint: str) -> None:
    started(cli, "head_on", endpoint)
    find_plan(endpoint, "*", 20.0)
    relay = cli.run("relay", "2", "--connect", endpoint, "--wait", "0.5")
    assert relay.returncode == 1
    waiting, gave_up = relay.stderr.splitlines()
    assert waiting.startswith("fleet: UAV 2 waits for its program at fleet/")
    assert "/2/step within 0.5 s; start it, or have the relay start it: -- PROGRAM" in gave_up
    missing = cli.run("relay", "2", "--connect", endpoint, "--", "no-such-program")
    assert (missing.returncode, missing.stderr.count("\n")) == (1, 1)
    assert "UAV 2: there is no program 'no-such-program' here" in missing.stderr
    strange = cli.run("relay", "9", "--connect", endpoint, "--", "no-such-program")
    assert (strange.returncode, strange.stderr.count("\n")) == (2, 1)
    assert "has no UAV 9" in strange.stderr


def test_with_certificates_relay_and_program_show_that_of_their_uav(
    cli: Cli, tmp_path: Path
) -> None:
    make_certificates(tmp_path / "certs", [1, 2], [], 1.0, time.time())
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0", "--secure", "certs")
    assert router.stderr is not None
    where = ("--connect", router.stderr.readline().split()[-1], "--secure", "certs")
    settings = ("--set", "uav.2.equipment=no_compute", "--json", "--out", "run.mcap")
    run = cli.start("run", "head_on", *settings, *where, "--external", "--duration", "2")
    cli.start("uav", "1", *where)
    cli.start("coordinator", *where)
    tls = tmp_path / "tls.py"
    tls.write_text(SECURED, encoding="utf-8")
    uav = cli.command(
        sys.executable, str(tls), str(FOREIGN), where[1], "2", str(tmp_path / "certs")
    )
    relay = cli.start("relay", "2", *where)
    assert len(truths(finished(cli, run, relay, uav))) == 21


SECURED = """
import json, sys
sys.path.insert(0, sys.argv[1])
import uav, zenoh
folder, number = sys.argv[4], sys.argv[3]
plain = zenoh.open
def opened(config):
    tls = {"root_ca_certificate": f"{folder}/ca.pem", "enable_mtls": True}
    tls |= {"connect_certificate": f"{folder}/uav-{number}.pem"}
    tls |= {"connect_private_key": f"{folder}/uav-{number}.key"}
    config.insert_json5("transport/link/tls", json.dumps(tls))
    return plain(config)
zenoh.open = opened
uav.answer_relay(sys.argv[2], number)
"""
