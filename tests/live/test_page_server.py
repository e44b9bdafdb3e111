"""The page's server: who is let in, what is taken from a browser, and that nobody holds it up."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from aiohttp import ClientSession, WSServerHandshakeError
from aiohttp.test_utils import TestServer

from fleet.config.explaining import plan_of_tables
from fleet.config.loading import read_scenario
from fleet.faults.shorthand import from_now_on, rules_of
from fleet.live import server
from fleet.live.server import LivePage, PageAccess
from fleet.live.source import Change, ChangeOutcome
from fleet.live.view import LiveView
from fleet.simulation.live_feed import LiveFrame

SCENARIO = read_scenario("head_on").scenario
WAIT_S = 20.0


class Counting:
    """A source whose frames are numbered by tick."""

    title, recorded = "a run", False

    def __init__(self) -> None:
        self.ticks, self.over = 0, False
        self.changes: list[Change] = []

    def frame(self, _after: int, *, whole: bool = False) -> LiveFrame | None:
        assert not whole
        self.ticks += 1
        return LiveFrame(self.ticks, self.ticks * 10**8, (), (), (), "", (), ())

    def past(self, _t_ns: int) -> LiveFrame | None:
        return None

    def is_over(self) -> bool:
        return self.over

    def change(self, change: Change) -> ChangeOutcome:
        self.changes.append(change)
        return ChangeOutcome(good=True, text="done")

    def close(self) -> None:
        pass


Visit = Callable[[ClientSession, str, Counting], Awaitable[None]]


def visited(visit: Visit, access: PageAccess = PageAccess()) -> Counting:  # noqa: B008 (frozen)
    """Serve a source, and let a visitor come."""

    async def both() -> Counting:
        source = Counting()
        page = LivePage(source, LiveView(SCENARIO), access)
        async with TestServer(page.application()) as at, ClientSession() as session:
            await asyncio.wait_for(visit(session, str(at.make_url("/")), source), WAIT_S)
        return source

    return asyncio.run(both())


async def views(socket: Any, count: int) -> list[dict[str, Any]]:
    """The next views of a socket; what else comes is left out."""
    found: list[dict[str, Any]] = []
    while len(found) < count:
        message = json.loads((await socket.receive()).data)
        if "view" in message:
            found.append(message["view"])
    return found


def test_a_browser_gets_the_page_and_all_that_it_needs_from_here() -> None:
    async def visit(session: ClientSession, url: str, _source: Counting) -> None:
        for name in server.STATIC:
            async with session.get(url + name) as response:
                assert response.status == 200
                text = await response.text()
                assert "http://" not in text.replace("http://www.w3.org", "")
                assert "https://" not in text
                assert "default-src 'self'" in response.headers["Content-Security-Policy"]
                assert "__TOKEN__" not in text
        async with session.get(url + "../pyproject.toml") as response:
            assert response.status == 404

    visited(visit)


def test_views_come_one_after_the_other_and_answers_between() -> None:
    async def visit(session: ClientSession, url: str, source: Counting) -> None:
        async with session.ws_connect(url + "live") as socket:
            first = json.loads((await socket.receive()).data)
            assert first["about"]["scenario"] == "head_on"
            ticks = [view["tick"] for view in await views(socket, 5)]
            assert ticks == sorted(set(ticks))
            await socket.send_json({"faults": {"kill": ["2"]}})
            while "outcome" not in (message := json.loads((await socket.receive()).data)):
                pass
            assert message["outcome"] == {"good": True, "text": "done"}
            assert source.changes == [Change(faults={"kill": ["2"]})]

    visited(visit)


def test_what_is_not_understood_is_refused_and_the_page_goes_on() -> None:
    async def visit(session: ClientSession, url: str, source: Counting) -> None:
        async with session.ws_connect(url + "live") as socket:
            for nonsense in ("", "{", '{"faults": 3}', '{"format": "disk"}', "[" * 10_000):
                await socket.send_str(nonsense)
                while "outcome" not in (message := json.loads((await socket.receive()).data)):
                    pass
                assert not message["outcome"]["good"]
                assert message["outcome"]["text"].startswith("not understood")
            await views(socket, 2)
        assert source.changes == []

    visited(visit)


def test_a_page_that_only_shows_changes_nothing() -> None:
    async def visit(session: ClientSession, url: str, source: Counting) -> None:
        async with session.ws_connect(url + "live") as socket:
            assert json.loads((await socket.receive()).data)["about"]["read_only"]
            await socket.send_json({"faults": {"kill": ["2"]}})
            while "outcome" not in (message := json.loads((await socket.receive()).data)):
                pass
            assert message["outcome"] == {"good": False, "text": "this page only shows"}
        assert source.changes == []

    visited(visit, PageAccess(read_only=True))


def test_without_the_token_nobody_is_let_in() -> None:
    async def visit(session: ClientSession, url: str, _source: Counting) -> None:
        for wrong in ("", "?token=", "?token=open-sesam", "?token=open-sesame2"):
            for name in server.STATIC:
                async with session.get(url + name + wrong) as response:
                    assert response.status == 403
            with pytest.raises(WSServerHandshakeError):
                await session.ws_connect(url + "live" + wrong)
        async with session.get(url + "?token=open-sesame") as response:
            assert "page.js?token=open-sesame" in await response.text()
        async with session.ws_connect(url + "live?token=open-sesame") as socket:
            await views(socket, 1)

    visited(visit, PageAccess(token="open-sesame"))


def test_another_page_in_the_same_browser_is_not_let_in() -> None:
    async def visit(session: ClientSession, url: str, _source: Counting) -> None:
        for origin in ("http://evil.example", "null", "http://127.0.0.1:1"):
            with pytest.raises(WSServerHandshakeError):
                await session.ws_connect(url + "live", origin=origin)
        async with session.ws_connect(url + "live", origin=url.rstrip("/")) as socket:
            await views(socket, 1)

    visited(visit)


def test_a_browser_that_takes_nothing_holds_nobody_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "FRAME_S", 0.001)
    big = {"t_s": 0.0, "tick": 0, "padding": "x" * 200_000}
    monkeypatch.setattr(LiveView, "take", lambda _view, frame: {**big, "tick": frame.tick})

    async def visit(session: ClientSession, url: str, source: Counting) -> None:
        async with session.ws_connect(url + "live") as slow, ClientSession() as other:
            await slow.receive()
            async with other.ws_connect(url + "live") as quick:
                await views(quick, 150)
            first, *_, last = await views(slow, 150)
            assert last["tick"] - first["tick"] > 150  # what it could not take was left out
            assert source.ticks >= 150

    visited(visit)


def test_all_hear_that_the_run_is_over() -> None:
    async def visit(session: ClientSession, url: str, source: Counting) -> None:
        async with session.ws_connect(url + "live") as socket:
            await views(socket, 2)
            source.over = True
            source.frame = lambda *_, **__: None  # type: ignore[method-assign]
            while "over" not in (message := json.loads((await socket.receive()).data)):
                pass
            assert message["over"] == "the run is over"

    visited(visit)


def test_a_site_that_has_its_own_name_lead_here_is_not_let_in() -> None:
    async def visit(session: ClientSession, url: str, _source: Counting) -> None:
        port = url.rstrip("/").rpartition(":")[2]
        for name in ("evil.example", f"evil.example:{port}", "127.0.0.1.evil.example", "[::1"):
            theirs = {"Host": name, "Origin": f"http://{name}"}
            async with session.get(url, headers=theirs) as response:
                assert response.status in (400, 403)
            with pytest.raises(WSServerHandshakeError):
                await session.ws_connect(url + "live", headers=theirs)
        for name in ("localhost", f"127.0.0.1:{port}", f"[::1]:{port}"):
            ours = {"Host": name, "Origin": f"http://{name}"}
            async with session.get(url, headers=ours) as response:
                assert response.status == 200

    visited(visit)


def test_who_has_the_token_may_come_by_any_name() -> None:
    async def visit(session: ClientSession, url: str, _source: Counting) -> None:
        named = {"Host": "flights.example"}
        async with session.get(url + "?token=open-sesame", headers=named) as response:
            assert response.status == 200

    visited(visit, PageAccess(token="open-sesame"))


def test_what_each_field_of_a_fault_shows_as_an_example_is_accepted() -> None:
    async def visit(session: ClientSession, url: str, _source: Counting) -> None:
        async with session.get(url) as response:
            form = (await response.text()).partition('<form id="faults"')[2].partition("</form>")[0]
        shown = dict(re.findall(r'<input name="(\w+)" placeholder="([^"]+)"', form))
        assert shown.keys() == {"latency", "loss", "burst", "range", "partition"}
        assert len(shown) == form.count("<input")
        for name, example in shown.items():
            varied = {"loss": ["20%"]} if name == "burst" else {}  # bursts are of a loss
            rules = rules_of(from_now_on({**varied, name: [example]}), 0.2)
            assert len(plan_of_tables(rules)) == 1

    visited(visit)
