"""Where the command `fleet` begins: Ctrl-C is one line also while everything is being imported."""

from __future__ import annotations

import os
import sys


def start() -> None:
    """Run the command line."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by who called
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115
    from fleet.errors import FleetError  # noqa: PLC0415

    try:
        from fleet.cli import main as command_line  # noqa: PLC0415 (takes a fifth of a second)
    except KeyboardInterrupt:
        sys.stderr.write("fleet: interrupted\n")
        sys.exit(130)
    except FleetError as error:  # a module of FLEET_FAULT_KINDS
        sys.stderr.write(f"fleet: {error}\n")
        sys.exit(2)
    command_line()
