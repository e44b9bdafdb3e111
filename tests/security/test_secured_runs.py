"""Runs with certificates, over real zenoh: the same digest, and nobody passes who has no right."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from fleet.security.certificates import make_certificates
from tests.conftest import Cli
from tests.rogue_secured import secured_outcomes

RUN = ("run", "head_on", "--duration", "3", "--json", "--force")


@pytest.fixture
def certs(tmp_path: Path) -> str:
    """Certificates of two UAVs, and of one that does not take part."""
    make_certificates(tmp_path / "certs", [1, 2, 7], [], 1.0, time.time())
    return "certs"


def digest_in_memory(cli: Cli) -> str:
    return str(json.loads(cli.run(*RUN, "--bus", "memory", "--out", "m.mcap").stdout)["digest"])


def test_processes_on_several_hosts_join_with_their_own_certificates(cli: Cli, certs: str) -> None:
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0", "--secure", certs)
    assert router.stderr is not None
    endpoint = router.stderr.readline().split()[-1]
    assert endpoint.startswith("tls/")
    joins = ("--connect", endpoint, "--secure", certs)
    run = cli.start(*RUN, *joins, "--external", "--out", "run.mcap")
    for role in (("coordinator",), ("uav", "1"), ("uav", "2")):
        cli.start(*role, *joins)
    stranger = cli.run("uav", "7", *joins)
    assert "has no UAV 7" in stranger.stderr
    out, error = run.communicate(timeout=60)
    assert (run.returncode, error) == (0, "")
    assert json.loads(out)["digest"] == digest_in_memory(cli)


def test_no_attack_passes_without_the_right_certificate(cli: Cli) -> None:
    """In one run, whose digest is that of one without attacks."""
    told = secured_outcomes(cli, "lockstep")
    assert [f"{name}: {t}" for name, t in told.items() if not t.startswith("refused")] == []


def test_a_run_does_not_begin_without_all_certificates_of_those_whom_it_starts(
    cli: Cli, certs: str
) -> None:
    (cli.folder / certs / "uav-2.key").unlink()
    refused = cli.run(*RUN, "--secure", certs, "--out", "run.mcap")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1), refused.stderr
    assert "has no uav-2.key" in refused.stderr
    assert not (cli.folder / "run.mcap").exists()


def test_an_open_router_says_that_it_is_one(cli: Cli) -> None:
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    assert "listening on tcp/127.0.0.1:" in router.stderr.readline()
    assert "the bus is open: whoever reaches" in router.stderr.readline()
