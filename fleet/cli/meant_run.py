"""Which of the runs that are on is meant."""

from __future__ import annotations

from msgspec.structs import replace

from fleet.cli.secure import identity_in
from fleet.errors import BusError
from fleet.security.identity import OPERATOR
from fleet.simulation.active_runs import ActiveRun, active_runs
from fleet.transport.run_search import find_plan
from fleet.transport.zenoh_session import SessionOptions

FIND_TIMEOUT_S = 10.0


def meant_run(run: str, connect: str, secure: str, zenoh_config: str) -> ActiveRun:
    """The run that is meant; one on this machine says itself where certificates and so on are."""
    if connect:
        found = ActiveRun(run, connect, "", secure, zenoh_config)
        if run:
            return found
        name, _ = find_plan(connect, "*", FIND_TIMEOUT_S, operator_session(found))
        return replace(found, run=name)
    known = {listing.run: listing for listing in active_runs()}
    if run in known:
        return known[run]
    names = ", ".join(f"{r.run} ({r.scenario})" for r in known.values()) or "none"
    if run:
        raise BusError(f"no run {run} on this machine; there is: {names}; or name its --connect")
    if len(known) == 1:
        return next(iter(known.values()))
    raise BusError(
        "no run on this machine; start one with 'fleet run', or name another host's --connect"
        if not known
        else f"several runs: {names}; name one"
    )


def operator_session(run: ActiveRun) -> SessionOptions:
    """How an operator opens a session to a run."""
    return SessionOptions(identity_in(run.secure, OPERATOR), run.zenoh_config)
