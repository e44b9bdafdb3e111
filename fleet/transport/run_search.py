"""Finding a run that a router carries, and asking it."""

from __future__ import annotations

import time

import zenoh

from fleet.errors import BusError
from fleet.printing import printable
from fleet.protocol.topics import PLAN, key
from fleet.transport.zenoh_bus import Bus
from fleet.transport.zenoh_session import BY_DEFAULT, SessionOptions, open_client


def _plans(session: zenoh.Session) -> dict[str, bytes]:
    """The plans of all runs that the router carries, by name."""
    replies = session.get(key("*", PLAN), timeout=1.0)
    good = [reply.ok for reply in replies if reply.ok is not None]
    return {str(r.key_expr).split("/")[1]: r.payload.to_bytes() for r in good}


def find_plan(
    endpoint: str, run: str, timeout_s: float, options: SessionOptions = BY_DEFAULT
) -> tuple[str, bytes]:
    """The name and plan of the run (`*`: the only one) that a router carries; waits for one.

    Raises:
        BusError: no router, no simulation, several runs to choose from, or only others.

    """
    deadline = time.monotonic() + timeout_s
    session = open_client(endpoint, timeout_s, options)
    others: set[str] = set()
    try:
        while time.monotonic() < deadline:
            found = _plans(session)
            if run in found:
                return run, found[run]
            names = ", ".join(map(printable, sorted(found)))
            if run == "*" and len(found) > 1:
                raise BusError(f"several runs at {endpoint}: {names}; choose one with --run")
            if run == "*" and found:
                return found.popitem()
            if others & found.keys():  # asked twice: one that is busy may answer too late
                raise BusError(f"no run '{printable(run)}' at {endpoint}; there: {names}")
            others = set(found)
            time.sleep(0.1)  # no simulation yet: it may start after its UAVs
        raise BusError(f"no run at {endpoint} within {timeout_s:g} s; start 'fleet run' there")
    finally:
        session.close()


def ask(
    endpoint: str,
    run: str,
    topic: str,
    payload: bytes,
    timeout_s: float,
    options: SessionOptions = BY_DEFAULT,
) -> bytes | None:
    """The answer of a run's simulation to a question; None if there is none in time.

    Raises:
        BusError: no router answers at the endpoint.

    """
    session = open_client(endpoint, timeout_s, options)
    with Bus(session, run, "", endpoint) as bus:
        return bus.ask(topic, payload, timeout_s)
