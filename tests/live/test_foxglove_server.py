"""The same scene over Foxglove's protocol, and faults as parameters."""

from __future__ import annotations

import asyncio
import json
import math
import re
import signal
import socket
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType

from fleet.analysis.recorded_run import RecordedRun
from fleet.config.loading import load_scenario
from fleet.errors import BusError
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.faults.plan import plan_json
from fleet.live.foxglove_server import FaultParameters, FoxgloveServer
from fleet.live.source import Change, ChangeOutcome
from fleet.simulation.live_feed import LiveFrame
from tests.conftest import Cli
from tests.live.test_live_run import said

WAIT_S = 30.0


class Asked:
    """A source that keeps what is asked for."""

    title, recorded = "a run", False

    def __init__(self) -> None:
        self.changes: list[Change] = []

    def frame(self, _after: int, *, whole: bool = False) -> LiveFrame | None:  # noqa: ARG002
        raise AssertionError("parameters need no frame")

    def past(self, _t_ns: int) -> LiveFrame | None:
        return None

    def is_over(self) -> bool:
        return False

    def change(self, change: Change) -> ChangeOutcome:
        self.changes.append(change)
        return ChangeOutcome(good=True, text="")

    def close(self) -> None:
        pass


def frame(*plan: Any, down: tuple[int, ...] = ()) -> LiveFrame:
    return LiveFrame(10, 10**9, (), (), (), plan_json(plan), (), down, speed=2.0)


def test_a_parameter_replaces_the_rules_of_its_kind() -> None:
    source = Asked()
    controls = FaultParameters(source)
    over = Loss(probability=0.1, end_s=0.5)
    controls.note(frame(over, Loss(probability=0.3), Kill(node="2"), down=(2,)))
    assert controls.set("loss", "20%").good
    assert source.changes[-1] == Change(faults={"loss": ["20%"]}, end=(1,))
    assert controls.set("loss", "").good
    assert source.changes[-1] == Change(end=(1,))
    values = controls.values()
    assert (values["loss"], values["kill"], values["speed"]) == ("", "2", 2.0)


def test_a_parameter_tells_no_rule_that_somebody_else_has_ended() -> None:
    controls = FaultParameters(Asked())
    controls.note(frame())
    assert controls.set("loss", "20%").good
    controls.note(frame(Loss(probability=0.2)))
    assert controls.values()["loss"] == "20%"
    controls.note(frame(Loss(probability=0.2, end_s=0.9)))
    assert controls.values()["loss"] == ""


def test_rules_that_the_scenario_brought_are_told() -> None:
    controls = FaultParameters(Asked())
    brought = Loss(probability=0.3), Corrupt(probability=0.1, start_s=5.0)
    controls.note(frame(*brought))
    values = controls.values()
    assert values["loss"] == brought[0].words(when=True)
    assert values["rules"] == [rule.words(when=True) for rule in brought]
    assert controls.set("loss", "20%").good  # ends what was brought
    controls.note(frame(*brought, Loss(probability=0.2)))
    assert controls.values()["loss"] == "20%"
    others = Loss(probability=0.2), Loss(probability=0.4)
    controls.note(frame(*brought, *others))
    assert controls.values()["loss"] == "; ".join(rule.words(when=True) for rule in others)
    assert controls.set("loss", "").good
    assert controls.values()["loss"] == ""


@pytest.mark.parametrize("speed", ["fast", None, True, [2.0], math.nan, math.inf])
def test_a_speed_that_is_no_number_is_refused(speed: Any) -> None:
    source = Asked()
    assert not FaultParameters(source).set("speed", speed).good
    assert source.changes == []


@pytest.mark.parametrize("paused", ["no", "false", "", None, 0, 1.0, []])
def test_a_pause_that_is_neither_true_nor_false_is_refused(paused: Any) -> None:
    source = Asked()
    outcome = FaultParameters(source).set("paused", paused)
    assert (outcome.good, outcome.text) == (False, f"'{paused}' is neither true nor false")
    assert source.changes == []


def test_who_is_killed_already_is_not_killed_again() -> None:
    source = Asked()
    controls = FaultParameters(source)
    controls.note(frame(Kill(node="coordinator"), Kill(node="3", start_s=60.0), down=(0,)))
    assert controls.values()["kill"] == "coordinator"
    assert controls.set("kill", "2,coordinator").good
    assert source.changes == [Change(faults={"kill": ["2"]}, end=(1,))]


def test_who_is_no_longer_named_is_started_again() -> None:
    source = Asked()
    controls = FaultParameters(source)
    controls.note(frame(Kill(node="2"), Kill(node="3"), down=(2, 3)))
    assert controls.set("kill", "3, coordinator").good
    assert source.changes == [Change(faults={"kill": ["coordinator"]}, end=(0,))]
    assert not controls.set("nosuch", "1").good


def test_a_log_is_seen_by_whoever_speaks_the_protocol(cli: Cli) -> None:
    cli.run("run", "head_on", "--bus", "memory", "--duration", "40", "--out", "y.mcap")
    server = cli.start("live", "y.mcap", "--foxglove")
    address = said(server, r"(ws://\S+)")

    async def visit() -> None:
        async with (
            ClientSession() as session,
            session.ws_connect(address, protocols=["foxglove.sdk.v1"]) as viewer,
        ):
            topics: dict[int, str] = {}
            moments = list[float]()
            while len(moments) < 3:
                message = await viewer.receive()
                if message.type is WSMsgType.BINARY:
                    shown = json.loads(message.data[13:])
                    places = {t["child_frame_id"]: t["translation"] for t in shown["transforms"]}
                    stamp = shown["transforms"][0]["timestamp"]
                    moments.append(stamp["sec"] + stamp["nsec"] / 1e9)
                    # 25 m/s to the north from the first place, as head_on begins
                    assert places.keys() == {"uav/1", "uav/2"}
                    continue
                said_of = json.loads(message.data)
                if said_of["op"] == "advertise":
                    topics |= {c["id"]: c["topic"] for c in said_of["channels"]}
                    wanted = [i for i, topic in topics.items() if topic == "/tf"]
                    listing = [{"id": i, "channelId": i} for i in wanted]
                    await viewer.send_json({"op": "subscribe", "subscriptions": listing})
            assert {"/tf", "/zones", "/routes", "/poses"} <= set(topics.values())
            assert moments == sorted(moments)

    asyncio.run(asyncio.wait_for(visit(), WAIT_S))


class Viewer:
    """What a viewer says and hears of parameters; it is a site of somebody else."""

    def __init__(self, link: ClientWebSocketResponse) -> None:
        self._link = link

    async def values(self) -> dict[str, Any]:
        """All parameters."""
        await self._link.send_json({"op": "getParameters", "parameterNames": [], "id": "all"})
        while True:
            told = await self._heard("parameterValues")
            if told.get("id") == "all":
                return {p["name"]: p.get("value") for p in told["parameters"]}

    async def set(self, name: str, value: Any) -> None:
        """Ask for another value."""
        asked = [{"name": name, "value": value}]
        await self._link.send_json({"op": "setParameters", "parameters": asked, "id": "set"})

    async def answer(self, name: str, value: Any) -> Any:
        """Ask for another value; which one the answer tells."""
        await self.set(name, value)
        while True:
            told = await self._heard("parameterValues")
            if told.get("id") == "set":
                return {p["name"]: p.get("value") for p in told["parameters"]}[name]

    async def complaint(self) -> str:
        """Wait for what the server complains of."""
        return str((await self._heard("status"))["message"])

    async def _heard(self, kind: str) -> dict[str, Any]:
        while True:
            message = await self._link.receive()
            assert message.type in (WSMsgType.TEXT, WSMsgType.BINARY), message
            if message.type is WSMsgType.TEXT:
                told: dict[str, Any] = json.loads(message.data)
                if told["op"] == kind:
                    return told


@pytest.mark.parametrize("control", [False, True])
def test_a_site_of_others_changes_a_run_only_if_viewers_may(
    cli: Cli, tmp_path: Path, *, control: bool
) -> None:
    here = {"XDG_RUNTIME_DIR": str(tmp_path)}
    flags = ("--duration", "60", "--loss", "10%", "--speed", "1", "--out", "x.mcap")
    run = cli.start("run", "head_on", *flags, **here)
    how = "--foxglove-control" if control else "--foxglove"
    server = cli.start(
        "live", said(run, r"^run (\w+):"), how, "--wait", "30", "--port", "0", **here
    )
    address = said(server, r"(ws://\S+)")
    headers = {"Origin": "http://others.example"}

    async def visit() -> None:
        async with (
            ClientSession(headers=headers) as session,
            session.ws_connect(address, protocols=["foxglove.sdk.v1"]) as link,
        ):
            viewer = Viewer(link)
            while not (values := await viewer.values())["rules"]:
                pass  # before the first frame
            assert values["loss"] == Loss(probability=0.1).words(when=True)
            await viewer.set("kill", "2")
            if not control:
                assert "--foxglove-control" in await viewer.complaint()
            while control and (await viewer.values())["kill"] != "2":
                pass
            if control:
                assert await viewer.answer("speed", 0.0) == 0.0

    asyncio.run(asyncio.wait_for(visit(), WAIT_S))
    if not control:
        run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == (0 if control else 130), err
    plan = RecordedRun.of_log(tmp_path / "x.mcap").plan
    assert [rule.name for rule in plan] == ["loss", "kill"][: 1 + control]


def test_the_answer_to_a_change_tells_the_new_value(cli: Cli, tmp_path: Path) -> None:
    here = {"XDG_RUNTIME_DIR": str(tmp_path)}
    run = cli.start("run", "head_on", "--duration", "600", "--speed", "1", **here)
    how = ("--foxglove-control", "--wait", "30", "--port", "0")
    address = said(cli.start("live", said(run, r"^run (\w+):"), *how, **here), r"(ws://\S+)")

    async def visit() -> None:
        async with (
            ClientSession() as session,
            session.ws_connect(address, protocols=["foxglove.sdk.v1"]) as link,
        ):
            viewer = Viewer(link)
            assert await viewer.answer("speed", 4.0) == 4.0
            assert await viewer.answer("paused", value=True) is True
            # nobody dies before the run goes on
            for killed in ("2", "2,coordinator", "coordinator", ""):
                assert await viewer.answer("kill", killed) == killed
                assert (await viewer.values())["kill"] == killed
            assert await viewer.answer("paused", value=False) is False

    asyncio.run(asyncio.wait_for(visit(), WAIT_S))
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=60)


def test_a_port_that_is_taken_is_one_line(cli: Cli) -> None:
    cli.run("run", "head_on", "--bus", "memory", "--duration", "5", "--out", "y.mcap")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = cli.run("live", "y.mcap", "--foxglove", "--port", str(port))
        of_run = FoxgloveServer(Asked(), load_scenario("head_on"), control=False)
        # as 'fleet run --foxglove' shows it beside the run, which has no --port itself
        with pytest.raises(BusError, match="; 'fleet live RUN --foxglove --port 0' takes any"):
            of_run.serve("127.0.0.1", port, lambda _: None)
    assert done.returncode == 2
    line = rf"fleet: cannot serve Foxglove at 127.0.0.1:{port} .*; 'fleet live LOG --foxglove .*\n"
    assert re.fullmatch(line, done.stderr)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (("--host", "0.0.0.0"), "lets others go to other times of the log: give a --token"),
        (("--host", "0.0.0.0", "--read-only"), "lets others look: give a --token"),
        (("--host", "0.0.0.0", "--foxglove"), "give --read-only, or --foxglove-control if they"),
        (("--host", "0.0.0.0", "--foxglove"), "may pause the log, too"),
        (("--foxglove", "--token", "long-enough"), "knows no token"),
        (("--foxglove-control", "--read-only"), "not both"),
    ],
)
def test_others_than_this_machine_are_let_in_only_if_that_was_meant(
    cli: Cli, more: tuple[str, ...], why: str
) -> None:
    cli.run("run", "head_on", "--bus", "memory", "--duration", "5", "--out", "y.mcap")
    done = cli.run("live", "y.mcap", *more)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert why in done.stderr
