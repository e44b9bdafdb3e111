"""`fleet recover`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fleet.log.recovery import recover

LOST = 3
"""The exit code when data was lost."""


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("recover")(recover_log)


def recover_log(
    log: Annotated[Path, typer.Argument(help="An MCAP log that is cut short or damaged.")],
    out: Annotated[
        Path | None, typer.Option(help="The new log; default LOG-recovered.mcap beside the old.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
) -> int:
    """Write all that is good of a damaged log to a new one; exit code 3 if anything was lost.

    Example: fleet recover killed.mcap --out saved.mcap
    """
    found = recover(log, out or log.with_name(f"{log.stem}-recovered.mcap"), overwrite=force)
    lost = "; ".join(found.lost)
    print(
        f"{found.out}: {found.messages:,} messages up to {found.until_ns / 1e9:g} s kept, "
        + (f"lost: {lost}" if lost else "nothing lost")
    )
    return LOST if lost else 0
