"""Opens a recording in rerun: its own window, or a page that only this machine can reach.

rerun listens on all addresses unless it is told otherwise, asks the network for news, fonts and
examples, and reports its use. Its window is bound to loopback here and reports nothing (it does not
where CI is set). Its page is taken from it once and served by a server of our own, with a content
security policy: the browser then asks nobody else.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import NamedTuple

from fleet.errors import LogError
from fleet.extras import import_extra

LOOPBACK_HOST = "127.0.0.1"
VIEWER_TIMEOUT_S = 30.0
POLICY = (
    "default-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:"
)
FOREIGN_LINK = re.compile(rb'<link\b[^>]*"https?://[^>]*>')
"""Links of the page that a browser follows before it heeds the policy."""
RECORDING = "/recording.rrd"
PARTS = ("/", "/favicon.svg", "/re_viewer.js", "/re_viewer_bg.wasm")
"""What the page of rerun consists of."""


class Answer(NamedTuple):
    """What a server says to GET."""

    body: bytes
    kind: str
    encoding: str = ""


def has_display() -> bool:
    """Whether a window can be opened: known on Linux, taken for granted elsewhere."""
    screens = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    return sys.platform != "linux" or any(os.environ.get(name) for name in screens)


def open_window(recording: Path) -> int:
    """Show a recording in rerun's own window until that is closed; returns its exit code."""
    import_extra("rerun", "rerun")
    command = [sys.executable, "-m", "rerun", str(recording), "--bind", LOOPBACK_HOST, "--new"]
    return subprocess.run(command, env=_environment(), check=False).returncode  # noqa: S603


@contextmanager
def page(recording: Path, port: int) -> Iterator[tuple[str, ThreadingHTTPServer]]:
    """The address of a page that shows a recording, and its server, to be run by the caller.

    Raises:
        LogError: the port is taken, or rerun does not start.

    """
    import_extra("rerun", "rerun")
    try:
        server = _Server((LOOPBACK_HOST, port), _Handler)
    except OSError as error:
        raise LogError(
            f"cannot listen on {LOOPBACK_HOST}:{port}: {error.strerror}; use another --port"
        ) from error
    with server:
        shown = Answer(recording.read_bytes(), "application/octet-stream")
        server.answers = {**_parts(), RECORDING: shown}
        base = f"http://{LOOPBACK_HOST}:{server.server_port}"
        yield f"{base}/?url={base}{RECORDING}&hide_welcome_screen=1&theme=dark", server


class _Server(ThreadingHTTPServer):
    """Has an answer for each path."""

    daemon_threads = True
    answers: Mapping[str, Answer]


class _Handler(BaseHTTPRequestHandler):
    """Gives it."""

    server: _Server
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """Answer, and say that nothing from elsewhere may be loaded."""
        answer = self.server.answers.get(self.path.partition("?")[0])
        if answer is None:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(answer.body)))
        self.send_header("Content-Security-Policy", POLICY)
        if answer.encoding:
            self.send_header("Content-Encoding", answer.encoding)
        self.end_headers()
        with contextlib.suppress(ConnectionError):
            self.wfile.write(answer.body)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def _parts() -> dict[str, Answer]:
    """The page of rerun, from its own web server."""
    found = {}
    with _viewer() as port, contextlib.closing(HTTPConnection(LOOPBACK_HOST, port)) as rerun:
        for path in PARTS:
            rerun.request("GET", path, headers={"Accept-Encoding": "gzip"})
            reply = rerun.getresponse()
            body, head = reply.read(), reply.headers
            if reply.status == 200:
                encoding = head.get("Content-Encoding", "")
                found[path] = Answer(body, head.get_content_type(), encoding)
    start = found["/"]
    return {**found, "/": start._replace(body=FOREIGN_LINK.sub(b"", start.body))}


@contextmanager
def _viewer() -> Iterator[int]:
    """The web server of rerun itself, on loopback; its port."""
    web, grpc = _free_port(), _free_port()
    command = [sys.executable, "-m", "rerun", "--serve-web", "--bind", LOOPBACK_HOST]
    command += ["--web-viewer-port", str(web), "--port", str(grpc)]
    process = subprocess.Popen(  # noqa: S603
        command,
        env=_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # it starts another process, which has to end with it
    )
    try:
        _await(process, "Hosting a web-viewer")
        yield web
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.communicate(timeout=VIEWER_TIMEOUT_S)


def _await(process: subprocess.Popen[bytes], what: str) -> None:
    """Wait until a process says something on standard error; raises LogError if it ends first."""
    assert process.stderr is not None
    said = b""
    for line in process.stderr:
        said = line
        if what.encode() in line:
            return
    raise LogError(f"rerun did not start: {said.decode(errors='replace').strip()}")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK_HOST, 0))
        return int(probe.getsockname()[1])


def _environment() -> dict[str, str]:
    return {**os.environ, "CI": "true"}
