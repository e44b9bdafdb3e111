"""The examples of a foreign UAV, used wrongly or given up: a line at most, and no traceback."""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
import sys

import pytest

from tests.conftest import Cli
from tests.relay.programs import FOREIGN
from tests.support.replay_tools import client, until

NODE = shutil.which("node")
GIVEN_UP = (-signal.SIGINT, 130)
"""Ended by Ctrl-C: a shell tells both as 130."""


@pytest.mark.parametrize("name", ["uav.py", "direct.py"])
@pytest.mark.parametrize(
    "words", [(), ("tcp/127.0.0.1:1",), ("tcp/127.0.0.1:1", "two"), ("1",) * 3]
)
def test_who_names_no_endpoint_and_number_is_told_to(
    name: str, words: tuple[str, ...], cli: Cli
) -> None:
    program = cli.command(sys.executable, str(FOREIGN / name), *words)
    out, error = program.communicate(timeout=60)
    assert (program.returncode, out) == (2, "")
    assert error == f"usage: python {name} ENDPOINT NUMBER\n"


@pytest.mark.skipif(NODE is None, reason="there is no Node.js here")
@pytest.mark.parametrize("line", ["{", "5", "null", '{"tick": 1}'])
def test_what_no_relay_asks_is_answered_by_who_should(line: str) -> None:
    words = ["node", str(FOREIGN / "uav.js")]
    done = subprocess.run(
        words, input=line + "\n", capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "usage: fleet relay NUMBER -- node uav.js\n"


def given_up(program: subprocess.Popen[str]) -> None:
    program.send_signal(signal.SIGINT)
    out, error = program.communicate(timeout=20)
    assert program.returncode in GIVEN_UP
    assert (out, error) == ("", "")


@pytest.mark.parametrize("name", ["uav.py", "direct.py"])
def test_it_is_given_up_while_there_is_no_router(name: str, cli: Cli) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:  # takes a link, and says nothing
        where = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        program = cli.command(sys.executable, str(FOREIGN / name), where, "2")
        mute.settimeout(60)
        link, _ = mute.accept()
        with link:
            given_up(program)


@pytest.mark.parametrize("name", ["uav.py", "direct.py"])
def test_it_is_given_up_while_it_waits_for_a_run(name: str, cli: Cli) -> None:
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    where = router.stderr.readline().split()[-1]
    with client(where) as session:
        asked: list[str] = []
        plans = session.declare_queryable(
            "fleet/run/sim/plan", lambda query: asked.append(str(query.key_expr))
        )
        program = cli.command(sys.executable, str(FOREIGN / name), where, "2")
        # The one asks for a plan, which it does not get; the other answers, though not a relay.
        until(lambda: bool(asked or [*session.get("fleet/run/2/step", timeout=1.0)]))
        given_up(program)
        plans.undeclare()
