"""Attacks on real runs over real zenoh; `python -m tests.rogue` tries them all."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.simulation.fault_control import LONGEST_BYTES, request_of
from tests.conftest import Cli
from tests.rogue import ATTACKS, DEEP, attacked, silent
from tests.rogue_processes import ROGUES, tried


@pytest.mark.parametrize(
    ("name", "clock"),
    [
        ("a ghost's broadcast", "lockstep"),
        ("a forged command", "lockstep"),
        ("a forged command", "realtime"),
        ("garbage as the clock", "lockstep"),
        ("a dead UAV's true state", "realtime"),
        ("a dead UAV's broadcast", "lockstep"),
        ("a broadcast before its UAV is started again", "realtime"),
    ],
)
def test_no_attack_passes_in_silence(name: str, clock: str, tmp_path: Path) -> None:
    told = attacked(ATTACKS[name], clock, tmp_path)
    assert silent(ATTACKS[name], told) == ""


@pytest.mark.parametrize(
    ("name", "clock"),
    [
        ("(nobody is a rogue)", "lockstep"),
        ("a UAV that hears what the fault plan takes from it", "lockstep"),
        ("a UAV that does not say where its radio is, under a fault of range", "lockstep"),
        ("a log that names code, repeated", "lockstep"),
        ("a simulation that names code, joined", "realtime"),
    ],
)
def test_no_rogue_goes_unnoticed(name: str, clock: str, tmp_path: Path) -> None:
    told = tried(ROGUES[name], clock, tmp_path)
    assert not told.startswith("SILENT"), told


@pytest.mark.parametrize("payload", [DEEP, b"[" * 100_000, b" " * (LONGEST_BYTES + 1), b"\xff"])
def test_a_request_that_nobody_can_mean_is_refused_with_a_reason(payload: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        request_of(payload)


def test_a_replay_keeps_out_of_a_run_that_is_on(cli: Cli, tmp_path: Path) -> None:
    """And a coordinator out of a run that has none."""
    log = tmp_path / "old.mcap"
    made = cli.run("run", "head_on", "--duration", "1", "--bus", "memory", "--out", str(log))
    assert made.returncode == 0, made.stderr
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    endpoint = router.stderr.readline().split()[-1]
    local = ("--set", "coordination.electors=local")
    cli.start("run", "head_on", "--connect", endpoint, "--external", *local)
    refused = cli.run("coordinator", "--connect", endpoint)
    assert refused.returncode == 2
    assert "has no coordinator" in refused.stderr
    assert refused.stderr.count("\n") == 1
    name = refused.stderr.split("run ")[1].split(":")[0]
    for options, code in (((), 2), (("--force-live",), 0)):
        again = cli.run(
            "replay", str(log), "--run", name, "--connect", endpoint, "-r", "1000", *options
        )
        assert again.returncode == code, again.stderr
        if code:
            assert f"run {name} is on at {endpoint}" in again.stderr
            assert len(again.stderr.splitlines()) == 1
