"""`fleet uav`, `fleet coordinator`, `fleet router`: one role by hand, on any host."""

from __future__ import annotations

import os
import signal
import sys
from typing import Annotated

import typer

from fleet.agents.process import uav_main
from fleet.cli.secure import Secure, identity_in, known_uavs, say_open
from fleet.cli.trust import Trust, refuse_code
from fleet.config.checks import problem_with
from fleet.coordinator.process import coordinator_main
from fleet.errors import ScenarioError
from fleet.model.types import COORDINATOR
from fleet.node.participant import JoinInfo, join_info_of
from fleet.protocol.topics import issuer_name
from fleet.security.identity import ROUTER
from fleet.security.links import router_settings
from fleet.simulation.interrupts import SIGNALS
from fleet.transport.zenoh_bus import LEASE_S, find_plan, open_router

Connect = Annotated[
    str,
    typer.Option(metavar="ENDPOINT", help="The run's zenoh router, as in tcp/192.0.2.1:7447."),
]
Run = Annotated[str, typer.Option(help="Name of the run, if the router carries several.")]
Wait = Annotated[
    float, typer.Option(min=0.1, max=3600.0, help="Seconds to wait for the router and the run.")
]


ROUTER_RUNTIME = "(rx: (worker_threads: 64))"
"""zenoh keeps a thread busy for 10 s where it closes a silent link; with its two threads the whole
router stands still when two links fall silent together, as those of a host that is cut off."""


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("uav")(uav)
    app.command("coordinator")(coordinator)
    app.command("router")(router)


def uav(
    number: Annotated[int, typer.Argument(metavar="ID", min=1, help="Which UAV to be.")],
    connect: Connect = "tcp/127.0.0.1:7447",
    run: Run = "*",
    wait: Wait = 60.0,
    trust: Trust = False,
    secure: Secure = "",
) -> int:
    """Be one UAV of a run that was started with 'fleet run --external' (it tells the scenario).

    Example: fleet uav 3 --connect tcp/127.0.0.1:7447
    """
    join_info = _join(issuer_name(number), connect, run, wait, secure)
    if not trust:
        refuse_code(join_info.scenario, f"run {join_info.run}")
    try:
        uav_main(join_info, number)
    except ValueError as error:
        raise ScenarioError(f"run {join_info.run}: {error}") from error
    return 0


def coordinator(
    connect: Connect = "tcp/127.0.0.1:7447",
    run: Run = "*",
    wait: Wait = 60.0,
    secure: Secure = "",
) -> int:
    """Be the coordinator of a run that was started with 'fleet run --external'."""
    join_info = _join(issuer_name(COORDINATOR), connect, run, wait, secure)
    try:
        coordinator_main(join_info)
    except ValueError as error:
        raise ScenarioError(f"run {join_info.run}: {error}") from error
    return 0


def router(
    listen: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Where to listen; port 0 takes any free one.")
    ] = "tcp/127.0.0.1:7447",
    lease: Annotated[
        float,
        typer.Option(
            min=0.5,
            max=86_400.0,
            help="Clients hold on to this router for so many seconds of silence.",
        ),
    ] = LEASE_S,
    secure: Secure = "",
) -> int:
    """Run a zenoh router for 'fleet run --connect'; ends with Ctrl-C.

    With --secure it lets in the UAVs whose certificates (uav-N.pem) are in the folder.
    """
    os.environ.setdefault("ZENOH_RUNTIME", ROUTER_RUNTIME)
    identity = identity_in(secure, ROUTER)
    secured = router_settings(identity, known_uavs(secure)) if identity else None
    session, where = open_router(listen, lease_s=lease, secured=secured)
    print(f"fleet: router listening on {where}", file=sys.stderr, flush=True)
    say_open(where, secure)
    try:
        signal.sigwait(SIGNALS)
    finally:
        session.close()
    return 0


def _join(issuer: str, connect: str, run: str, wait_s: float, secure: str) -> JoinInfo:
    name, plan = find_plan(connect, run, wait_s, identity_in(secure, issuer))
    try:
        join_info = join_info_of(connect, name, plan, secure, issuer)
    except ValueError as error:
        raise ScenarioError(
            f"run {name}: its simulation speaks another version ({error})"
        ) from error
    problem = problem_with(join_info.scenario)
    if problem:
        raise ScenarioError(
            f"run {name}: its simulation tells of an impossible scenario: {problem}"
        )
    return join_info
