"""`fleet conformance`."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from fleet.cli.screen import Screen
from fleet.conformance.rule import Outcome, RuleFinding
from fleet.conformance.scene import FOREIGN
from fleet.conformance.session import exit_code, found, played
from fleet.errors import ArgumentError, BusError
from fleet.model.words import ClockMode

_STYLES = {Outcome.KEPT: "green", Outcome.BROKEN: "bold red", Outcome.NOT_TRIED: "yellow"}
_LEAVE_S = 2.0
"""So long a UAV that was started here may take to end."""


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("conformance")(conformance)


def conformance(
    endpoint: Annotated[
        str, typer.Argument(metavar="ENDPOINT", help="Where to listen; port 0: any free one.")
    ] = "tcp/127.0.0.1:7447",
    clock: Annotated[
        ClockMode | None,
        typer.Option(help="Only on this clock; else on both, one after the other."),
    ] = None,
    start: Annotated[
        str,
        typer.Option(
            metavar="COMMAND",
            help="Start the UAV so, for each clock; {endpoint} and {number} are filled in.",
        ),
    ] = "",
    wait: Annotated[
        float, typer.Option(min=0.1, max=3600.0, help="Seconds to wait for the UAV to join.")
    ] = 60.0,
    patience: Annotated[
        float, typer.Option(min=0.2, max=600.0, help="Seconds that a step may take it.")
    ] = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> int:
    """Try a UAV of your own: plays a run to UAV 2, and names each rule that it keeps or breaks.

    It needs equipment no_compute, and joins as UAV 2 at the endpoint, once for each clock.

    Exit code: all rules are kept (0), one is broken (1), or nothing is broken, but not all of them
    could be tried (2).

    \b
    Examples:
      fleet conformance --start "python direct.py {endpoint} {number}"
      fleet conformance --start "fleet relay {number} --connect {endpoint} -- node uav.js"
    """  # noqa: D301 (the \b keeps the lines apart)
    findings: list[RuleFinding] = []
    for mode in [clock] if clock else ClockMode:
        findings += _tried(endpoint, mode, start, wait, patience)
    if as_json:
        told = {"exit_code": exit_code(findings), "rules": [asdict(f) for f in findings]}
        print(json.dumps(told))
    else:
        _show(findings)
    return exit_code(findings)


def _tried(
    endpoint: str, clock: ClockMode, start: str, wait_s: float, patience_s: float
) -> list[RuleFinding]:
    """What a UAV makes of one clock."""
    processes: list[subprocess.Popen[bytes]] = []

    def gone() -> bool:
        return any(process.poll() is not None for process in processes)

    with _started(start, clock, processes) as listening:
        evidence = played(
            endpoint,
            clock,
            wait_s=wait_s,
            patience_s=patience_s,
            listening=listening,
            gone=gone,
        )
        ended = [process.returncode for process in processes if process.poll() is not None]
    if not evidence.heard and ended:
        raise BusError(
            f"what --start has started ended with exit code {ended[0]} before it had joined for "
            f"the {clock} clock; it has to join as UAV {FOREIGN} where it is told to"
        )
    if not evidence.heard:
        raise BusError(
            f"no UAV {FOREIGN} joined for the {clock} clock within {wait_s:g} s; start it once it "
            "is said where to join, or mend what it does before it is ready"
        )
    return found(evidence)


@contextmanager
def _started(
    start: str, clock: ClockMode, processes: list[subprocess.Popen[bytes]]
) -> Iterator[Callable[[str], None]]:
    """Says where to join, and starts the UAV there if that is asked for; it is gone afterwards."""

    def listening(endpoint: str) -> None:
        sys.stderr.write(f"fleet: {clock}: UAV {FOREIGN} can join at {endpoint}\n")
        sys.stderr.flush()
        if start:
            processes.append(_process(start, endpoint))

    try:
        yield listening
        for process in processes:
            process.wait(_LEAVE_S)
    except subprocess.TimeoutExpired:
        sys.stderr.write("fleet: the UAV did not end, and was killed\n")
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _process(start: str, endpoint: str) -> subprocess.Popen[bytes]:
    try:
        told = start.format(endpoint=endpoint, number=FOREIGN)
    except (ValueError, LookupError) as error:
        raise ArgumentError(
            f"--start '{start}': only {{endpoint}} and {{number}} are filled in; write other "
            "braces twice"
        ) from error
    try:
        return subprocess.Popen(shlex.split(told), stdin=subprocess.DEVNULL)  # noqa: S603
    except (OSError, ValueError) as error:
        raise ArgumentError(f"--start '{start}' cannot be started: {error}") from error


def _show(findings: Sequence[RuleFinding]) -> None:
    console, table = Screen(highlight=False), Table()
    for column in ("rule", "clock", "outcome"):
        table.add_column(column)
    for f in findings:
        told = f"[{_STYLES[f.outcome]}]{f.outcome}[/]"
        table.add_row(escape(f.name), f.clock, told)
    console.print(table)
    for f in findings:
        if f.outcome is not Outcome.KEPT:
            named = f"[{_STYLES[f.outcome]}]{f.outcome}[/]: [bold]{escape(f.name)}[/] ({f.clock})"
            told = f"{named}: {escape(f.seen)}; docs/protocol/{f.page}"
            console.print(told, soft_wrap=True)
    counted = {outcome: sum(f.outcome is outcome for f in findings) for outcome in Outcome}
    console.print(", ".join(f"{n} {outcome}" for outcome, n in counted.items()))
