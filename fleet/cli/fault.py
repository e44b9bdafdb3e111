"""`fleet fault`: change the fault plan of a fleet that is flying."""

from __future__ import annotations

import sys
from typing import Annotated

import msgspec
import typer

from fleet.cli.faults import Given, fault_tables, with_fault_options
from fleet.cli.meant_run import meant_run, operator_session
from fleet.cli.result import fault_lines
from fleet.cli.secure import Secure
from fleet.cli.zenoh_config import ZenohConfig
from fleet.config.explaining import plan_of_tables
from fleet.errors import BusError
from fleet.faults.options import by_option
from fleet.faults.shorthand import from_now_on
from fleet.protocol.topics import FAULT
from fleet.simulation.fault_control import FaultRequest, answer_of
from fleet.transport.run_search import ask

REPLY_TIMEOUT_S = 10.0
DEFAULT_BROADCAST_S = 0.2


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(with_fault_options(fault))


def fault(
    run: Annotated[
        str, typer.Argument(help="Name of the run (default: the only one on this machine).")
    ] = "",
    clear: Annotated[
        bool, typer.Option("--clear", help="End all faults that are in force or to come.")
    ] = False,
    connect: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Router of a run on another host.")
    ] = "",
    secure: Secure = "",
    zenoh_config: ZenohConfig = "",
    faults: Given | None = None,
) -> int:
    """Change the fault plan of a running fleet; it takes effect at its next tick and is logged.

    Without a window (WHAT@START+LENGTH, in simulated time) a fault begins at once and stays.

    \b
    Examples:
      fleet fault --loss 50%
      fleet fault 3f2a90c1 --kill 2
      fleet fault --pause coordinator@+5s
      fleet fault --clear
    """  # noqa: D301 (the \b keeps the lines apart)
    tables = fault_tables(from_now_on(faults or {}), DEFAULT_BROADCAST_S)
    if not tables and not clear:
        raise typer.BadParameter("nothing to change: give a fault, as --loss 30%, or --clear")
    try:
        rules = plan_of_tables(tables)
    except ValueError as error:
        raise typer.BadParameter(by_option(str(error), 0, tables)) from error
    target = meant_run(run, connect, secure, zenoh_config)
    request = msgspec.json.encode(FaultRequest(rules, clear))
    session = operator_session(target)
    reply = ask(target.endpoint, target.run, FAULT, request, REPLY_TIMEOUT_S, session)
    if reply is None:
        raise BusError(
            f"run {target.run} does not answer at {target.endpoint}: it has ended, or has no tick "
            f"within {REPLY_TIMEOUT_S:g} s"
        )
    answer = answer_of(reply)
    if answer.problem:
        why = by_option(answer.problem, answer.first, tables)
        print(f"fleet: run {target.run} refuses: {why}", file=sys.stderr)
        return 2
    print(f"run {target.run}: from {answer.t_s:g} s (tick {answer.tick}) the fault plan is")
    for line in fault_lines(answer.plan):
        print(f"  {line}")
    for why in answer.idle:
        named = by_option(why, answer.first, tables)
        print(f"fleet: warning: {named}", file=sys.stderr)
    return 0
