"""Two routers that are linked: participants connect to either, and hear each other as at one."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import pytest

from fleet.security.certificates import make_certificates
from tests.conftest import Cli, fly


def router(cli: Cli, *options: str) -> tuple[subprocess.Popen[str], str]:
    """A router of its own, and where it listens."""
    process = cli.start("router", "--listen", "tcp/127.0.0.1:0", *options)
    assert process.stderr is not None
    return process, process.stderr.readline().split()[-1]


@pytest.mark.parametrize("secured", [False, True])
def test_a_run_over_two_linked_routers_is_that_over_one(
    cli: Cli, tmp_path: Path, *, secured: bool
) -> None:
    secure = ("--secure", "certs") if secured else ()
    if secured:
        make_certificates(tmp_path / "certs", [1, 2], [], 1.0, time.time())
    _, here = router(cli, *secure)
    _, there = router(cli, "--link", here, *secure)
    arguments = ("--duration", "30", "--connect", here, "--external", "--json", *secure)
    run = cli.start("run", "head_on", *arguments)
    roles = (("uav", "1", here), ("uav", "2", there), ("coordinator", there))
    others = [cli.start(*role[:-1], "--connect", role[-1], *secure) for role in roles]
    out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert json.loads(out)["digest"] == fly("head_on", "duration_s=30").digest
    assert [other.wait(timeout=30) for other in others] == [0, 0, 0]


def test_a_link_that_is_no_endpoint_is_one_line(cli: Cli) -> None:
    done = cli.run("router", "--listen", "tcp/127.0.0.1:0", "--link", "127.0.0.1:7447")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "'127.0.0.1:7447' is no endpoint; write PROTOCOL/ADDRESS" in done.stderr
