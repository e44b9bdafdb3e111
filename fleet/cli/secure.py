"""`--secure DIR` of the commands that join a bus, and `fleet certs`, which makes such a folder."""

from __future__ import annotations

import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from fleet.cli.environment import SECURE_VARIABLE
from fleet.config.uav_numbers import numbers_in
from fleet.extras import import_extra
from fleet.security.identity import Identity, certified_uavs
from fleet.security.loading import checked_identity

_HELP = "Mutual TLS with the certificates in this folder, made by 'fleet certs'."
Secure = Annotated[str, typer.Option("--secure", metavar="DIR", help=_HELP)]
SecureHere = Annotated[
    str, typer.Option("--secure", metavar="DIR", envvar=SECURE_VARIABLE, help=_HELP)
]
"""The same for a role by hand, which a unit or container may start."""
MOST_DAYS = 36_500.0


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("certs")(certs)


def identity_in(folder: str, *issuers: str) -> Identity | None:
    """The identity that a command shows, that of the first issuer; None without a folder."""
    return checked_identity(folder, time.time(), *issuers)


def say_open(endpoint: str, secure: str) -> None:
    """Tell who can be reached by anybody."""
    if not secure and not endpoint.startswith("unix"):
        print(
            f"fleet: the bus is open: whoever reaches {endpoint} can rule the fleet "
            "(--secure DIR closes it)",
            file=sys.stderr,
            flush=True,
        )


def certs(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to put them.")],
    uavs: Annotated[
        str, typer.Option(metavar="IDS", help="UAVs that get one, as in 1-8 or 1,2,30-40.")
    ] = "1-16",
    host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Name or IP address by which others reach the router, beside those of this "
            "machine. Can be given many times.",
        ),
    ] = None,
    days: Annotated[
        float, typer.Option(min=0.01, max=MOST_DAYS, help="How long they are valid.")
    ] = 365.0,
) -> int:
    """Make the certificates of a fleet: an authority, and one for each role and UAV.

    What is there already stays as it is: run it again to add UAVs. Each host needs ca.pem and the
    pair of its own role; ca.key is needed only here.

    \b
    Examples:
      fleet certs certs --uavs 1-4
      fleet run four_way --secure certs
    """  # noqa: D301 (the \b keeps the lines apart)
    try:
        numbers = numbers_in(uavs)
    except ValueError as error:
        raise typer.BadParameter(f"--uavs {error}") from error
    import_extra("cryptography", "secure", "'fleet certs'")
    making = import_module("fleet.security.certificates")
    files = making.make_certificates(folder, numbers, host or [], days, time.time())
    made = [file for file in files if file.made]
    if not made:
        print(f"{folder}: all {len(files)} certificates are there; nothing was changed")
    else:
        kept = f"; {len(files) - len(made)} were there and stay" if len(made) < len(files) else ""
        print(f"{folder}: {len(made)} certificates with their keys made{kept}")
    first = min(files, key=lambda file: file.until)
    print(f"the first to expire is {first.path.name}, on {first.until:%Y-%m-%d %H:%M} UTC")
    if made and files[0].made:
        print(f"keep {folder / 'ca.key'} to yourself: whoever has it can be anybody")
    return 0


def known_uavs(folder: str) -> list[int]:
    """The UAVs that a router lets in: those whose certificates (without keys) are in its folder."""
    return certified_uavs(Path(folder))
