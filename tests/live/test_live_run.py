"""`fleet live` beside a run of real processes: what is clicked happens, is logged, and repeats."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
from pathlib import Path
from typing import Any, cast

import pytest
from aiohttp import ClientSession

from fleet.analysis.recorded_run import RecordedRun
from fleet.errors import BusError
from fleet.live.run_source import RunSource
from fleet.live.source import Change
from fleet.transport.zenoh_bus import Bus, open_client_bus
from fleet.transport.zenoh_session import open_router
from tests.conftest import Cli

WAIT_S = 60.0


def said(process: subprocess.Popen[str], pattern: str) -> str:
    """What a pattern finds in what a process says on standard error."""
    assert process.stderr is not None
    heard = ""
    for line in process.stderr:
        heard += line
        found = re.search(pattern, line)
        if found:
            return found[1]
    raise AssertionError(heard)


class Browser:
    """What the page's script does, without drawing."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self.view: dict[str, Any] = {}
        self.over = ""

    async def until(self, seen: Any) -> Any:
        """Take what comes until something is seen in it; the outcome of a change, if it is one."""
        while True:
            message = json.loads((await asyncio.wait_for(self._socket.receive(), WAIT_S)).data)
            self.view = message.get("view", self.view)
            self.over = message.get("over", self.over)
            found = seen(message)
            if found:
                return found

    async def ask(self, **change: Any) -> str:
        """Ask for a change; what came of it."""
        await self._socket.send_json(change)
        outcome = await self.until(lambda message: message.get("outcome"))
        assert outcome["good"], outcome
        return str(outcome["text"])

    async def seen(self, condition: Any) -> None:
        """Wait for a view of which something holds."""
        await self.until(lambda message: "view" in message and condition(message["view"]))


def test_a_kill_from_the_page_is_in_the_log_and_repeats(cli: Cli, tmp_path: Path) -> None:
    here = {"XDG_RUNTIME_DIR": str(tmp_path)}
    flags = ("--duration", "30", "--speed", "4", "--out", "run.mcap")
    run = cli.start("run", "four_way", *flags, **here)
    name = said(run, r"^run (\w+):")
    page = cli.start("live", name, "--wait", "30", **here)
    address = said(page, r"(http://\S+)")

    async def visit() -> None:
        async with ClientSession() as session, session.ws_connect(address + "live") as socket:
            browser = Browser(socket)
            await browser.seen(lambda view: view["t_s"] > 0.5)
            assert "tick" in await browser.ask(faults={"kill": ["2"], "loss": ["20%"]})
            await browser.seen(lambda view: view["down"] == [2])
            killed = next(r["n"] for r in browser.view["rules"] if r["kind"] == "kill")
            await browser.ask(paused=True)
            await browser.seen(lambda view: view["paused"])
            tick = browser.view["tick"]
            await browser.ask(end=[killed])  # while it is paused
            await browser.ask(steps=2)
            await browser.seen(lambda view: view["tick"] == tick + 2)
            assert browser.view["down"] == []
            await browser.ask(paused=False, speed=0.0)
            await browser.until(lambda message: message.get("over"))

    asyncio.run(asyncio.wait_for(visit(), WAIT_S))
    _, err = run.communicate(timeout=WAIT_S)
    assert run.returncode == 0, err
    _, err = page.communicate(timeout=WAIT_S)
    assert page.returncode == 0, err
    plan = RecordedRun.of_log(tmp_path / "run.mcap").plan
    assert [type(rule).__name__ for rule in plan] == ["Loss", "Kill"]
    assert plan[1].end_s is not None
    repeated = cli.run("repeat", "run.mcap", **here)
    assert repeated.returncode == 0, repeated.stdout + repeated.stderr


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("nosuch",), "no run nosuch on this machine"),
        (("nosuch.mcap",), "cannot read nosuch.mcap"),
        (
            ("some.mcap", "--connect", "tcp/127.0.0.1:1", "--wait", "9"),
            "some.mcap is a log; --connect and --wait: for a run alone",
        ),
        (("some.mcap", "--wait", "9"), "some.mcap is a log; --wait: for a run alone"),
        (("--host", "0.0.0.0"), "lets others change the run: give a --token"),
        (("--token", "short"), "at least 8"),
        (("--token", "this+that&more"), "as they stand in an address"),
        (("--foxglove", "--host", "0.0.0.0"), "may change the run, too"),
        (("--host", "no.such.host.invalid", "--token", "long-enough"), "no run on this machine"),
    ],
)
def test_what_cannot_be_shown_is_said_in_a_line(
    cli: Cli, tmp_path: Path, arguments: tuple[str, ...], why: str
) -> None:
    done = cli.run("live", *arguments, XDG_RUNTIME_DIR=str(tmp_path))
    assert done.returncode in (1, 2)
    assert why in done.stderr
    assert done.stderr.count("\n") == 1


def test_of_a_log_that_is_cut_the_page_says_what_info_says(cli: Cli, tmp_path: Path) -> None:
    cli.run("run", "head_on", "--bus", "memory", "--duration", "30", "--out", "whole.mcap")
    whole = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    info = re.findall(r"^fleet: warning: .*", cli.run("info", "cut.mcap").stderr, re.MULTILINE)
    assert "the log has no end" in info[0]
    page = cli.start("live", "cut.mcap")
    warned = [said(page, r"^(fleet: warning: .*)") for _ in info]
    address = said(page, r"(http://\S+)")
    assert warned == info

    async def visit() -> list[str]:
        async with ClientSession() as session, session.ws_connect(address + "live") as socket:
            about = json.loads((await socket.receive()).data)["about"]
            return [f"fleet: warning: cut.mcap: {warning}" for warning in about["warnings"]]

    assert asyncio.run(asyncio.wait_for(visit(), WAIT_S)) == info


def test_no_page_waits_for_a_run_that_cannot_begin(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "there.mcap").touch()
    done = cli.run("run", "head_on", "--live", "--out", "there.mcap", XDG_RUNTIME_DIR=str(tmp_path))
    assert done.returncode == 2
    assert "there.mcap exists already" in done.stderr
    # All that had this standard error has ended, and none has looked in vain.
    assert "no run" not in done.stderr


def test_faults_that_nobody_knows_are_refused() -> None:
    source = RunSource(cast("Bus", None), "a run")
    outcome = source.change(Change(faults={"lateness": ["3s"], "loss": ["20%"]}))
    assert (outcome.good, outcome.text) == (False, "no fault is called lateness")


def test_who_asks_after_the_session_has_ended_is_told_so() -> None:
    session, where = open_router("tcp/127.0.0.1:0")
    bus = open_client_bus("run", "viewer", where)
    bus.close()
    with pytest.raises(BusError, match="run run can no longer be asked"):
        bus.ask("sim/view", b"", 1.0)
    session.close()
