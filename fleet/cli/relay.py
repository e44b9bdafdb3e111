"""`fleet relay`: a UAV of a run whose flight and obedience are somebody else's program."""

from __future__ import annotations

from typing import Annotated

import typer

from fleet.cli.roles import Connect, Run, Wait, join_infos_of
from fleet.cli.secure import SecureHere
from fleet.cli.zenoh_config import ZenohConfigHere
from fleet.errors import ScenarioError
from fleet.protocol.topics import issuer_name
from fleet.relay.process import relay_main


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("relay")(relay)


def relay(
    number: Annotated[
        int, typer.Argument(metavar="ID", min=1, max=1_000_000, help="Which UAV to be.")
    ],
    program: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- PROGRAM ARG...]",
            help="Start this, and ask it by lines of JSON on its standard input and output.",
        ),
    ] = None,
    connect: Connect = "tcp/127.0.0.1:7447",
    run: Run = "*",
    wait: Wait = 60.0,
    secure: SecureHere = "",
    zenoh_config: ZenohConfigHere = "",
) -> int:
    """Be a UAV of a run that a program of your own flies: it is asked once in every step.

    The relay joins, hears, applies faults and radio ranges, orders, numbers and reports. Without a
    PROGRAM it asks one that answers over zenoh, at fleet/RUN/ID/step.

    \b
    Examples:
      fleet relay 2 --connect tcp/127.0.0.1:7447
      fleet relay 2 -- node uav.js
    """  # noqa: D301 (the \b keeps the lines apart)
    [join_info] = join_infos_of([issuer_name(number)], connect, run, wait, secure, zenoh_config)
    try:
        relay_main(join_info, number, program or (), wait)
    except ValueError as error:
        raise ScenarioError(f"run {join_info.run}: {error}") from error
    return 0
