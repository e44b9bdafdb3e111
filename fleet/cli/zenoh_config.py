"""`--zenoh-config FILE` of the commands that open a session of zenoh's."""

from __future__ import annotations

from typing import Annotated

import typer

from fleet.cli.environment import ZENOH_CONFIG_VARIABLE

_HELP = (
    "A JSON5 file of zenoh's own configuration, for what the fleet does not set itself "
    "(docs/hosts.md)."
)
ZenohConfig = Annotated[str, typer.Option("--zenoh-config", metavar="FILE", help=_HELP)]
ZenohConfigHere = Annotated[
    str,
    typer.Option("--zenoh-config", metavar="FILE", envvar=ZENOH_CONFIG_VARIABLE, help=_HELP),
]
"""The same for a role by hand, which a unit or container may start."""
