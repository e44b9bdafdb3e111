"""Each line that docs/protocol/foreign.md quotes is what a relay says of a program that is so."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

import fleet
from fleet.errors import ProgramError
from fleet.relay.medium import LONGEST_ANSWER_BYTES, AnswerLimits, Medium
from fleet.relay.pipe_medium import PipeMedium
from fleet.relay.relay_node import RelayNode
from fleet.relay.zenoh_medium import ZenohMedium
from fleet.transport.zenoh_bus import Bus
from tests.conftest import Cli
from tests.relay.programs import plain
from tests.relay.test_dialogue_docs import section
from tests.relay.test_relayed_runs import silent_in_lockstep, silent_until_the_run_is_over
from tests.relay.test_zenoh_medium import STEP, Scene
from tests.support.samples import pack

ROWS = [line for line in section("When that goes wrong").splitlines() if line.startswith("| ")][1:]
CELLS = [row.split("|")[2] for row in ROWS]
QUOTED = [q for cell in CELLS for q in re.findall(r"`([^`]* [^`]*)`", cell) if q[:6] != "fleet "]
TICK, TICK_NS = 9, 100_000_000
PATIENT = AnswerLimits(20.0)

SECOND_ANSWER = """
import os, sys, time
sys.stdin.readline()
print("[]", flush=True)
sys.stdin.readline()
{}
"""


def said(medium: Medium, bus: Bus, limits: AnswerLimits = PATIENT) -> str:
    """What is said of a program that answers the first question, and then does something else."""
    scenario = fleet.load_scenario("head_on", {"uav.2.equipment": "no_compute"})
    uav = scenario.uav[1]
    node = RelayNode(uav, scenario, lambda asked: plain(medium.ask(asked, limits)))

    def ask() -> None:
        medium.begin(bus, STEP, limits.timeout_s)
        node.step(TICK * TICK_NS, [])

    with pytest.raises(ProgramError) as raised:
        ask()
    return str(raised.value)


def over_a_pipe(does: str, *words: str, limits: AnswerLimits = PATIENT) -> str:
    program = words or (sys.executable, "-c", SECOND_ANSWER.format(does))
    bus, medium = SimpleNamespace(name="2", before_leaving=None), PipeMedium(program)
    line, process = said(medium, cast("Bus", bus), limits), medium._process
    medium.abandon()
    for stream in (process.stdin, process.stdout) if process else ():
        with suppress(OSError):  # it holds what nobody takes any more
            stream.close()  # type: ignore[union-attr]
    return line


def over_zenoh(folder: Path, *answers: bytes, times: int = 1) -> str:
    """What is said of as many programs as there are, whose answers are these."""
    scene = Scene(folder)
    try:
        for _ in range(times):
            left = [pack([]), *answers]
            scene.program(lambda _, left=left: left.pop(0))  # type: ignore[misc]
        return said(ZenohMedium(), scene.relay, AnswerLimits(20.0 if times else 0.1))
    finally:
        scene.close()


def endpoint_of(cli: Cli) -> str:
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    return router.stderr.readline().split()[-1]


def twice(folder: Path) -> str:
    scene = Scene(folder)
    try:
        for _ in range(2):
            scene.program(lambda _: pack([]))
        medium = ZenohMedium()

        def ask_until_both_are_known() -> None:
            medium.begin(scene.relay, STEP, 5.0)
            for _ in range(10_000):
                medium.ask(STEP, AnswerLimits(5.0))

        with pytest.raises(ProgramError) as raised:
            ask_until_both_are_known()
        return str(raised.value)
    finally:
        scene.close()


NAN = [["truth", {"speed_mps": float("nan")}]]
TOLD: dict[str, list[Callable[[Cli], str]]] = {
    "no program answers at": [lambda cli: over_zenoh(cli.folder, times=0)],
    "its program has not answered for": [
        lambda _: over_a_pipe("", "sleep", "1000", limits=AnswerLimits(0.1)),
        lambda _: over_a_pipe("time.sleep(1000)", limits=AnswerLimits(1.0)),
    ],
    "there is no program": [lambda _: over_a_pipe("", "no-such-program")],
    "its program has gone": [lambda _: over_a_pipe("sys.exit(3)")],
    "its program has gone within an answer": [lambda _: over_a_pipe("os.write(1, b'[[')")],
    "its program is there more than once": [lambda cli: twice(cli.folder)],
    "N is waiting for": [lambda cli: silent_in_lockstep(cli, endpoint_of(cli))],
    "process N ends": [lambda cli: silent_until_the_run_is_over(cli, endpoint_of(cli))],
    "what its program answers is no MessagePack": [
        lambda cli: over_zenoh(cli.folder, b"\xc1"),
        lambda cli: over_zenoh(cli.folder, b""),
    ],
    "a line on the standard output of its program is no JSON": [
        lambda _: over_a_pipe("print('hello', flush=True)"),
        lambda _: over_a_pipe('print(\'[["truth", {"speed_mps": NaN}]]\', flush=True)'),
    ],
    "what its program answers for tick 9 cannot be sent": [
        lambda _: over_a_pipe("print('\"what?\"', flush=True)"),
        lambda _: over_a_pipe("print('[]', flush=True)"),
        lambda _: over_a_pipe("print('[[\"heartbeat\", {}]]', flush=True)"),
        lambda _: over_a_pipe("print([0] * 257, flush=True)"),
        lambda cli: over_zenoh(cli.folder, pack(NAN)),
    ],
    "its program answers more than 1048576 bytes at once": [
        lambda _: over_a_pipe("print('x' * 2_000_000, flush=True)"),
        lambda cli: over_zenoh(cli.folder, pack("x" * LONGEST_ANSWER_BYTES)),
    ],
}
"""By how each line begins, programs of which it is said."""


def pattern(quoted: str) -> str:
    """What a quoted line stands for: of each run and program, and of any time-out."""
    words = re.escape(quoted).replace("PROGRAM", r"\S+").replace("RUN", "[^/]+")
    return re.sub(r"\b60\\ s", r"[0-9.]+\\ s", re.sub(r"\bN\b", "2", words))


@pytest.mark.parametrize("quoted", QUOTED)
def test_a_line_that_is_quoted_is_said(quoted: str, cli: Cli) -> None:
    begun = max((begin for begin in TOLD if quoted.startswith(begin)), key=len)
    for program in TOLD[begun]:
        line = program(cli)
        assert re.search(pattern(quoted), line), line


def test_every_line_is_quoted() -> None:
    assert {begin for begin in TOLD if any(q.startswith(begin) for q in QUOTED)} == {*TOLD}
