"""`fleet live`: a page in the browser that shows a run that is on, or a log, and changes it."""

from __future__ import annotations

import asyncio
import ipaddress
import os
import re
import secrets
import subprocess
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from fleet.cli.meant_run import meant_run, operator_session
from fleet.cli.reading import opened_run
from fleet.cli.secure import Secure
from fleet.cli.zenoh_config import ZenohConfig
from fleet.errors import BusError
from fleet.extras import import_extra
from fleet.live.log_source import LogSource
from fleet.live.run_source import RunSource, first_frame
from fleet.live.source import Source
from fleet.live.view import LiveView, scenario_of
from fleet.log.reader import summarise
from fleet.simulation.active_runs import ActiveRun, active_runs
from fleet.transport.zenoh_bus import open_client_bus

LOOPBACK = "127.0.0.1"
JOIN_TIMEOUT_S = 10.0
BESIDE_WAIT_S = 30.0
FOXGLOVE_PORT = 8765
"""Where Foxglove looks if it is not told otherwise."""
LEAST_TOKEN = 8
POLL_S = 0.1
EXTRA = "live"

FoxgloveControl = Annotated[
    bool,
    typer.Option(
        "--foxglove-control",
        help="--foxglove, and viewers may change faults and pace: so may any site that is open in "
        "a browser on this machine.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(live)


def live(
    what: Annotated[
        str,
        typer.Argument(
            metavar="[RUN or LOG]",
            help="Name of a run that is on (default: the only one here), or an MCAP log.",
        ),
    ] = "",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0: any that is free.")
    ] = 0,
    host: Annotated[
        str, typer.Option(help="Address to listen on; others than this machine need --token.")
    ] = LOOPBACK,
    token: Annotated[
        str, typer.Option(help="Who opens the page has to know it; 'new' makes one.")
    ] = "",
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Show alone: nothing can be changed from the page.")
    ] = False,
    wait: Annotated[
        float, typer.Option(min=0.0, max=3600.0, help="Seconds to wait for the run to begin.")
    ] = 0.0,
    foxglove: Annotated[
        bool,
        typer.Option("--foxglove", help="For Foxglove or Lichtblick instead of a page of its own."),
    ] = False,
    foxglove_control: FoxgloveControl = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    connect: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Router of a run on another host.")
    ] = "",
    secure: Secure = "",
    zenoh_config: ZenohConfig = "",
    beside: Annotated[int, typer.Option(hidden=True)] = 0,
) -> int:
    """Show a run while it flies, or a log, on a page in the browser; and change what it does.

    A fault that is added there changes the fault plan: it is logged, and 'fleet repeat' repeats it.

    \b
    Examples:
      fleet live
      fleet live four_way.mcap --open
      fleet live 3f2a90c1 --read-only --host 0.0.0.0 --token new
    """  # noqa: D301 (the \b keeps the lines apart)
    if foxglove or foxglove_control:
        _check_foxglove(what, host, token, read_only=read_only, control=foxglove_control)
        shown = _source(what, wait, connect, secure, zenoh_config, beside)
        control = foxglove_control or (shown[0].recorded and not read_only)
        return _serve_foxglove(shown, host, port, what if beside else "", control=control)
    import_extra("aiohttp", EXTRA, "the live page")
    token = secrets.token_urlsafe(12) if token == "new" else token  # noqa: S105 (a word)
    _check_access(what, host, token, read_only=read_only)
    source, view = _source(what, wait, connect, secure, zenoh_config, beside)
    server = import_module("fleet.live.server")
    page = server.LivePage(source, view, server.PageAccess(token, read_only))

    def ready(at: int) -> None:
        address = f"http://{_shown(host)}:{at}/" + (f"?token={token}" if token else "")
        _tell(source, address, what if beside else "")
        if open_:
            webbrowser.open(address)

    try:
        asyncio.run(server.serve(page, host, port, ready))
    except OSError as error:
        raise BusError(
            f"cannot serve the page at {host}:{port} ({error.strerror or error}); "
            "choose another --port, or 0 for any free one"
        ) from error
    finally:
        source.close()
    return 0


def _shown(host: str) -> str:
    """A host as it stands in an address."""
    return f"[{host}]" if ":" in host else host


def _is_on(run: str) -> bool:
    """Whether a run of this name is on here; any, if there is none."""
    return any(run in ("", listing.run) for listing in active_runs())


def _tell(source: Source, address: str, beside: str) -> None:
    """Say where it is shown, unless the run `beside` is over: then that has had its last word."""
    if not beside or _is_on(beside):
        print(f"fleet: {source.title}: {address}", file=sys.stderr, flush=True)


def _serve_foxglove(
    shown: tuple[Source, LiveView], host: str, port: int, beside: str, *, control: bool
) -> int:
    """Serve viewers that speak Foxglove's protocol, which knows no token."""
    source, view = shown
    server = import_module("fleet.live.foxglove_server")

    def ready(at: int) -> None:
        _tell(source, f"ws://{_shown(host)}:{at}", beside)

    try:
        server.FoxgloveServer(source, view.scenario, control=control).serve(host, port, ready)
    finally:
        source.close()
    return 0


def _check_foxglove(what: str, host: str, token: str, *, read_only: bool, control: bool) -> None:
    """Everybody who gets there is let in: that has to be meant."""
    if token:
        raise typer.BadParameter("Foxglove's protocol knows no token: drop --token")
    if read_only and control:
        raise typer.BadParameter("--read-only or --foxglove-control, not both")
    if not (_is_loopback(host) or read_only or control):
        raise typer.BadParameter(
            f"--host {host} lets others look: give --read-only, or --foxglove-control if they may "
            f"{'pause the log' if _is_log(what) else 'change the run'}, too"
        )


def _is_loopback(host: str) -> bool:
    """Whether nobody else gets to this address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _check_access(what: str, host: str, token: str, *, read_only: bool) -> None:
    """Nobody else is let in without a token."""
    if not _is_loopback(host) and not token:
        more = "go to other times of the log" if _is_log(what) else "change the run"
        allowed = "look" if read_only else more
        raise typer.BadParameter(
            f"--host {host} lets others {allowed}: give a --token ('new' makes one)"
        )
    if token and (len(token) < LEAST_TOKEN or not re.fullmatch(r"[A-Za-z0-9._~-]+", token)):
        raise typer.BadParameter(
            f"--token: at least {LEAST_TOKEN} letters or digits, as they stand in an address"
        )


def _is_log(what: str) -> bool:
    """Whether a log is meant, not a run."""
    return bool(what) and (what.endswith(".mcap") or Path(what).is_file())


def _source(
    what: str, wait_s: float, connect: str, secure: str, zenoh_config: str, beside: int
) -> tuple[Source, LiveView]:
    """What is shown: a log if there is such a file, else a run.

    `beside` is the process of the run that has started this one: if that run is over by now, it has
    said why, and there is nothing to add.
    """
    if _is_log(what):
        given = [
            name for name, is_given in (("--connect", connect), ("--wait", wait_s)) if is_given
        ]
        if given:
            raise typer.BadParameter(f"{what} is a log; {' and '.join(given)}: for a run alone")
        return _log(Path(what))
    until_s, parent = time.monotonic() + wait_s, beside or os.getppid()
    while not _is_on(what) and time.monotonic() < until_s and os.getppid() == parent:
        time.sleep(POLL_S)
    try:
        return _run(meant_run(what, connect, secure, zenoh_config))
    except BusError as error:
        if beside and not _is_on(what) and time.monotonic() < until_s:
            raise typer.Exit from error
        raise


def _run(run: ActiveRun) -> tuple[Source, LiveView]:
    """A run that is on."""
    bus = open_client_bus(run.run, "", run.endpoint, JOIN_TIMEOUT_S, operator_session(run))
    try:
        run_source = RunSource(bus, f"{run.scenario} {run.run}".strip())
        scenario = scenario_of(first_frame(run_source, run.run, run.endpoint))
    except BaseException:
        bus.close()
        raise
    return run_source, LiveView(scenario)


def _log(path: Path) -> tuple[Source, LiveView]:
    """A log; what is wrong with it is said here and on the page, as `fleet info` says it."""
    run = opened_run(path)
    warnings = [] if run.complete else summarise(path).warnings
    for warning in warnings:
        print(f"fleet: warning: {path}: {warning}", file=sys.stderr, flush=True)
    return LogSource(run, path.name), LiveView(run.scenario, recorded=True, warnings=warnings)


@contextmanager
def shown_beside(
    run: str, secure: str, *, live: bool, foxglove: bool, foxglove_control: bool
) -> Iterator[None]:
    """Have processes show a run that is about to begin, until that is over.

    `foxglove_control` says whether viewers of `foxglove` may change it.

    Raises:
        MissingExtraError: the library for what is to be shown is not installed.
    """
    if live:
        import_extra("aiohttp", EXTRA, "the live page")
    if foxglove:
        import_extra("foxglove", "foxglove", "--foxglove")
    command = [sys.executable, "-m", "fleet", "live", run, "--wait", f"{BESIDE_WAIT_S:g}"]
    command += ["--beside", str(os.getpid()), *(["--secure", secure] if secure else [])]
    more: list[list[str]] = [[]] * live
    if foxglove:
        how = "--foxglove-control" if foxglove_control else "--foxglove"
        more.append([how, "--port", str(FOXGLOVE_PORT)])
    # In sessions of their own: Ctrl-C is for the run, with which they end.
    processes = [
        subprocess.Popen(  # noqa: S603 (this program, and a run that it has named)
            [*command, *its], stdin=subprocess.DEVNULL, start_new_session=True
        )
        for its in more
    ]
    try:
        yield
    except BaseException:
        for process in processes:  # or they would wait for a run that cannot begin
            process.kill()
            process.wait()
        raise
