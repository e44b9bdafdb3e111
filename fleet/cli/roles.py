"""`fleet uav`, `fleet coordinator`, `fleet router`: one role by hand, on any host."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from fleet.agents.process import uav_main
from fleet.cli.environment import (
    CONNECT_VARIABLE,
    ID_VARIABLE,
    RUN_VARIABLE,
)
from fleet.cli.secure import SecureHere, identity_in, known_uavs, say_open
from fleet.cli.trust import Trust, refuse_code
from fleet.cli.zenoh_config import ZenohConfigHere
from fleet.config.checks import problem_with
from fleet.config.uav_numbers import numbers_in
from fleet.coordinator.process import coordinator_main
from fleet.errors import ScenarioError
from fleet.model.types import COORDINATOR
from fleet.node.join_info import JoinInfo, join_info_of
from fleet.protocol.topics import issuer_name
from fleet.security.identity import ROUTER
from fleet.security.links import router_settings
from fleet.simulation.interrupts import SIGNALS
from fleet.simulation.several_uavs import several_uavs
from fleet.transport.free_memory import GIVE_BACK_EVERY_S, give_back_free_memory
from fleet.transport.run_search import find_plan
from fleet.transport.zenoh_session import LEASE_S, SessionOptions, open_router

Connect = Annotated[
    str,
    typer.Option(
        metavar="ENDPOINT",
        envvar=CONNECT_VARIABLE,
        help="The run's zenoh router, as in tcp/192.0.2.1:7447.",
    ),
]
Run = Annotated[
    str,
    typer.Option(envvar=RUN_VARIABLE, help="Name of the run, if the router carries several."),
]
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
    ids: Annotated[
        str,
        typer.Argument(
            metavar="ID",
            envvar=ID_VARIABLE,
            help="Which UAV to be; or several, as in 1-50 or 1,2,30-40.",
        ),
    ],
    connect: Connect = "tcp/127.0.0.1:7447",
    run: Run = "*",
    wait: Wait = 60.0,
    trust: Trust = False,
    secure: SecureHere = "",
    zenoh_config: ZenohConfigHere = "",
) -> int:
    """Be a UAV of a run that was started with 'fleet run --external' (it tells the scenario).

    Several are a process each, which share memory; each that fails is named, the others go on.

    \b
    Examples:
      fleet uav 3 --connect tcp/127.0.0.1:7447
      fleet uav 1-50 --connect tcp/192.0.2.1:7447
    """  # noqa: D301 (the \b keeps the lines apart)
    try:
        numbers = numbers_in(ids)
    except ValueError as error:
        raise typer.BadParameter(f"ID {error}") from error
    issuers = [issuer_name(number) for number in numbers]
    join_infos = join_infos_of(issuers, connect, run, wait, secure, zenoh_config)
    join_info = join_infos[0]
    if not trust:
        refuse_code(join_info.scenario, f"run {join_info.run}")
    try:
        if len(numbers) > 1:
            return several_uavs(dict(zip(numbers, join_infos, strict=True)))
        uav_main(join_info, numbers[0])
    except ValueError as error:
        raise ScenarioError(f"run {join_info.run}: {error}") from error
    return 0


def coordinator(
    connect: Connect = "tcp/127.0.0.1:7447",
    run: Run = "*",
    wait: Wait = 60.0,
    secure: SecureHere = "",
    zenoh_config: ZenohConfigHere = "",
) -> int:
    """Be the coordinator of a run that was started with 'fleet run --external'."""
    [join_info] = join_infos_of(
        [issuer_name(COORDINATOR)], connect, run, wait, secure, zenoh_config
    )
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
    link: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Another router; what is said at one is heard at both. May be repeated.",
        ),
    ] = None,
    secure: SecureHere = "",
    zenoh_config: ZenohConfigHere = "",
) -> int:
    """Run a zenoh router for 'fleet run --connect'; ends with Ctrl-C.

    With --secure it lets in the UAVs whose certificates (uav-N.pem) are in the folder.
    """
    os.environ.setdefault("ZENOH_RUNTIME", ROUTER_RUNTIME)
    # All threads of zenoh inherit that: a signal waits for whoever waits for it.
    heeded = {number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, heeded)
    try:
        identity = identity_in(secure, ROUTER)
        secured = router_settings(identity, known_uavs(secure)) if identity else None
        session, where = open_router(
            listen, lease_s=lease, secured=secured, zenoh_config=zenoh_config, links=link or ()
        )
    except BaseException:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        raise
    print(f"fleet: router listening on {where}", file=sys.stderr, flush=True)
    say_open(where, secure)
    try:
        while signal.sigtimedwait(heeded, GIVE_BACK_EVERY_S) is None:
            give_back_free_memory()
    finally:
        session.close()
    return 0


def join_infos_of(
    issuers: Sequence[str], connect: str, run: str, wait_s: float, secure: str, zenoh_config: str
) -> list[JoinInfo]:
    """What each of these participants must know, in their order."""
    session = SessionOptions(identity_in(secure, *issuers), zenoh_config)
    name, plan = find_plan(connect, run, wait_s, session)
    try:
        join_infos = [
            join_info_of(connect, name, plan, secure, issuer, zenoh_config) for issuer in issuers
        ]
    except ValueError as error:
        raise ScenarioError(
            f"run {name}: its simulation speaks another version ({error})"
        ) from error
    problem = problem_with(join_infos[0].scenario)
    if problem:
        raise ScenarioError(
            f"run {name}: its simulation tells of an impossible scenario: {problem}"
        )
    return join_infos
