"""The page's server: one poller asks the source, and each browser gets the newest view it can take.

A view that comes before the browser has taken the last one replaces the one that waits: a slow page
sees fewer, and holds nobody up.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from importlib.resources import files
from ipaddress import ip_address
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import msgspec

from fleet.extras import import_extra
from fleet.live.history import History
from fleet.live.source import Change, ChangeOutcome, Source
from fleet.live.view import LiveView, ViewData

if TYPE_CHECKING:
    from aiohttp import web
else:
    web = import_extra("aiohttp.web", "live", "the live page")

FRAME_S = 0.1
"""So often the source is asked while anybody looks."""
UNSEEN_S = 0.5
"""While nobody looks it is asked so often whether the run is over."""
FAREWELL_S = 1.0
"""So long pages have to hear that it is."""
MOST_VIEWERS = 20
LONGEST_REQUEST_BYTES = 65536
STATIC = {
    "": ("page.html", "text/html"),
    "page.css": ("page.css", "text/css"),
    "plan.js": ("plan.js", "text/javascript"),
    "space.js": ("space.js", "text/javascript"),
    "panels.js": ("panels.js", "text/javascript"),
    "page.js": ("page.js", "text/javascript"),
}
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True)
class PageAccess:
    """Who may look, and do: `token` is asked for unless empty; `read_only` allows looking alone."""

    token: str = ""
    read_only: bool = False


class LivePage:
    """Serves one source to any number of browsers."""

    def __init__(self, source: Source, view: LiveView, access: PageAccess) -> None:
        self._source, self._view, self._access = source, view, access
        self._about = view.about(title=source.title, read_only=access.read_only)
        self._history = History(source, view) if source.recorded else None
        self._newest: ViewData | None = None
        self._fresh = asyncio.Condition()
        self._viewers = 0
        self.polling: asyncio.Task[None] | None = None
        self._over = ""
        self._asking = asyncio.Lock()

    def application(self) -> web.Application:
        """What aiohttp serves."""
        app = web.Application(middlewares=[self._guard])
        for name in STATIC:
            app.router.add_get(f"/{name}", self._file)
        app.router.add_get("/live", self._live)
        app.cleanup_ctx.append(self._polled)
        return app

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Let in who has the token, from a page of this server.

        Without a token by no name but this machine's: a site may have its own name lead here.
        """
        token, given = self._access.token, request.query.get("token", "")
        if not (token or _is_here(request.host)):
            return web.Response(status=403, text="not by this name: open the address as printed\n")
        if token and not hmac.compare_digest(given.encode(), token.encode()):
            text = "this page needs its token: open the whole address that 'fleet live' printed\n"
            return web.Response(status=403, text=text)
        origin = request.headers.get("Origin")
        if origin is not None and origin.partition("://")[2] != request.host:
            return web.Response(status=403, text="not from another page\n")
        response: web.StreamResponse = await handler(request)
        return response

    async def _file(self, request: web.Request) -> web.StreamResponse:
        name, kind = STATIC[request.path[1:]]
        text = files("fleet.live").joinpath("static", name).read_text(encoding="utf-8")
        if name == "page.html" and self._access.token:
            text = text.replace("__TOKEN__", f"?token={request.query['token']}")
        text = text.replace("__TOKEN__", "")
        return web.Response(text=text, content_type=kind, headers=HEADERS)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        if self._viewers >= MOST_VIEWERS:
            return web.Response(status=503, text=f"{MOST_VIEWERS} browsers look already\n")
        socket = web.WebSocketResponse(heartbeat=20.0, max_msg_size=LONGEST_REQUEST_BYTES)
        await socket.prepare(request)
        self._viewers += 1
        sending = asyncio.create_task(self._send_views(socket))
        try:
            async for message in socket:
                if message.type == web.WSMsgType.TEXT:
                    outcome = await self._asked(message.data)
                    await socket.send_json({"outcome": msgspec.to_builtins(outcome)})
        finally:
            self._viewers -= 1
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await sending
        return socket

    async def _send_views(self, socket: web.WebSocketResponse) -> None:
        """Send what does not change, then the newest view, each time that the last has gone.

        With that of a log comes what was flown since the last one, which may be of any time.
        """
        await socket.send_json({"about": self._about})
        sent: ViewData | None = None
        while not (socket.closed or self._over):
            async with self._fresh:
                while self._newest is sent and not self._over:
                    await self._fresh.wait()
                before, sent = sent, self._newest
            view = sent
            if self._history is not None and sent is not None:
                past = await asyncio.to_thread(self._history.between, before, sent)
                view = {**sent, "past": past}
            await socket.send_str(json.dumps({"view": view}, separators=(",", ":")))
        await socket.send_json({"over": self._over})

    async def _asked(self, text: str) -> ChangeOutcome:
        """Carry out what a browser asks for."""
        if self._access.read_only:
            return ChangeOutcome(good=False, text="this page only shows")
        try:
            change = msgspec.json.decode(text, type=Change)
        except (ValueError, RecursionError) as error:
            return ChangeOutcome(good=False, text=f"not understood: {error}")
        async with self._asking:
            return await asyncio.to_thread(self._source.change, change)

    async def _polled(self, _app: web.Application) -> AsyncIterator[None]:
        polling = self.polling = asyncio.create_task(self._poll())
        yield
        polling.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await polling

    async def _poll(self) -> None:
        """Ask for frames while anybody looks, until the run is over."""
        while True:
            view = None
            if self._viewers:
                async with self._asking:
                    view = await asyncio.to_thread(self._next)
            if view is None and await asyncio.to_thread(self._source.is_over):
                self._over = "the run is over"
            async with self._fresh:
                self._newest = self._newest if view is None else view
                self._fresh.notify_all()
            if self._over:
                return
            await asyncio.sleep(FRAME_S if self._viewers else UNSEEN_S)

    def _next(self) -> ViewData | None:
        after = 0 if self._source.recorded else self._view.last_event
        frame = self._source.frame(after)
        if frame is None:
            return None
        if self._source.recorded:
            self._view.forget_events()
        return self._view.take(frame)


def _is_here(host: str) -> bool:
    """Whether the `Host` of a request is an address or `localhost`, not a name of somebody's."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or bool(ip_address(name))
    except ValueError:
        return False


async def serve(page: LivePage, host: str, port: int, ready: Callable[[int], None]) -> None:
    """Serve until the run is over; `ready(port)` is called once the page can be opened.

    Raises:
        OSError: the port is taken, or the address is none of this machine's.
    """
    runner = web.AppRunner(page.application(), access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    try:
        site = web.TCPSite(runner, host, port)
        await site.start()
        ready(runner.addresses[0][1])
        if page.polling is not None:
            await page.polling
        await asyncio.sleep(FAREWELL_S)
    finally:
        await runner.cleanup()
