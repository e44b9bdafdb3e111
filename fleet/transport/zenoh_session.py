"""Sessions of zenoh: the settings of routers and clients, and how they are opened."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import zenoh

from fleet.errors import BusError
from fleet.printing import printable
from fleet.security.handshake import why_no_link
from fleet.security.identity import Identity
from fleet.security.links import LONGEST_MESSAGE_BYTES, client_settings, tls_endpoint
from fleet.transport.zenoh_config import ZenohTable, laid_below, zenoh_file_text

LEASE_S = 60.0
"""How long a link may be silent before it counts as lost, unless the run says otherwise."""
BEFORE_PROBE_S = 3.0
"""When a router has not answered for so long, it is looked into why."""


@dataclass(frozen=True)
class SessionOptions:
    """How a client opens its session: who it is, and how long it holds on to its link.

    With an identity the link is mutual TLS. `zenoh_config` is a file of zenoh's own configuration.
    The router ends a link that has been silent for longer than its lease; a session ends it itself
    when it could not get rid of a message for `patience_s`, and connects again.
    """

    identity: Identity | None = None
    zenoh_config: str = ""
    lease_s: float = LEASE_S
    patience_s: float = 5.0


BY_DEFAULT = SessionOptions()

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    # 64 B to 1 kB payloads gain nothing from it, and its counters limit the number of sessions.
    "transport/shared_memory/enabled": False,
    "transport/link/rx/max_message_size": LONGEST_MESSAGE_BYTES,
    # What is published while a link is silent waits here: about 1 MB, and nothing is lost of it.
    "transport/link/tx/queue/size/data": 16,
}
_ROUTER: dict[str, Any] = {
    "mode": "router",
    "adminspace/enabled": True,
    # Hundreds of UAVs connect at the same moment.
    "transport/unicast/accept_pending": 10_000,
    "transport/unicast/max_sessions": 10_000,
    "transport/unicast/accept_timeout": 60_000,
}
_PATIENCE = "transport/link/tx/queue/congestion_control/block/wait_before_close"
_LEASE = "transport/link/tx/lease"
_CONNECT_TIMEOUT = "connect/timeout_ms"
_CLIENT: dict[str, Any] = {
    "mode": "client",
    "listen/endpoints": [],
    "transport/unicast/open_timeout": 60_000,
    "connect/retry": {
        "period_init_ms": 100,
        "period_max_ms": 200,
        "period_increase_factor": 1.5,
    },
}


def _config(settings: dict[str, Any], file: str) -> zenoh.Config:
    own = {**_COMMON, **settings}
    return zenoh.Config.from_json5(json.dumps(laid_below(own, _file_table(file), file)))


def _file_table(file: str) -> ZenohTable:
    """The table in a file of zenoh's configuration; none without a file."""
    if not file:
        return {}
    text = zenoh_file_text(file)
    try:
        reader = zenoh.Config()
        reader.insert_json5("metadata", text)  # where anything may stand
        table = json.loads(reader.get_json("metadata"))
        if not isinstance(table, dict):
            raise BusError(f"--zenoh-config {file}: no table; write {{ key: value }}")
        zenoh.Config.from_json5(text)  # what it does not know it names
    except zenoh.ZError as error:
        raise BusError(f"--zenoh-config {file}: {_flaw(str(error))}") from error
    return table


def _flaw(error: str) -> str:
    """What zenoh does not like in a file, in a line."""
    place, wanted = re.search(r"--> (\d+):(\d+)", error), re.search(r" = ([^\"\\\n]+)", error)
    if place and wanted:
        return f"line {place[1]}, column {place[2]}: {wanted[1]}"
    return printable(error.split(" at /", maxsplit=1)[0].partition(", expected one of")[0])[:200]


def check_zenoh_config(options: SessionOptions) -> None:
    """Whether clients may have that file, before any of them is started; raises BusError."""
    _config(_client_settings("tcp/localhost:0", options), options.zenoh_config)


def _open(settings: dict[str, Any], endpoint: str, failure: str, file: str) -> zenoh.Session:
    _check_endpoint(endpoint)
    try:
        return zenoh.open(_config(settings, file))
    except zenoh.ZError as error:
        raise BusError(f"{failure} ({reason_of(str(error))})") from error


def _check_endpoint(endpoint: str) -> None:
    if not re.fullmatch(r"[a-z0-9-]+/\S+", endpoint):
        raise BusError(
            f"'{endpoint}' is no endpoint; write PROTOCOL/ADDRESS, as tcp/127.0.0.1:7447"
        )


def reason_of(error: str) -> str:
    """The part of zenoh's message that says why: it adds the whole way through its sources."""
    for known in ("Address already in use", "invalid port", "Cannot assign", "Timeout"):
        if known.lower() in error.lower():
            return known.lower()
    return error.split(" at /", maxsplit=1)[0][:120]


def open_router(
    endpoint: str,
    patience_s: float = 0.2,
    lease_s: float = LEASE_S,
    secured: Mapping[str, Any] | None = None,
    zenoh_config: str = "",
    links: Sequence[str] = (),
) -> tuple[zenoh.Session, str]:
    """A router-mode session listening on `endpoint` (port 0: any free one), and where it listens.

    A receiver that takes nothing holds everybody up for `patience_s` before it is disconnected.
    `secured` are settings for TLS and access control (`fleet.security.links.router_settings`).
    Clients hold on to a router that has been silent for up to its lease. `zenoh_config` is a file
    of zenoh's own configuration. `links` are the endpoints of other routers: it connects to them,
    again and again until they are there, and what is said at one is heard at all.

    Raises:
        BusError: an endpoint is malformed or taken, or the file is no good.

    """
    if secured:
        endpoint, links = tls_endpoint(endpoint), [tls_endpoint(link) for link in links]
    for link in links:
        _check_endpoint(link)
    failure = f"cannot listen on {endpoint}; choose another endpoint, or port 0 for any free one"
    own = {
        "listen/endpoints": [endpoint],
        _PATIENCE: round(1e6 * patience_s),
        _LEASE: round(1e3 * lease_s),
        **({"connect/endpoints": [*links]} if links else {}),
        **(secured or {}),
    }
    session = _open({**_ROUTER, **own}, endpoint, failure, zenoh_config)
    replies = session.get(f"@/{session.zid()}/router")
    for reply in replies:
        if reply.ok is not None:
            told = json.loads(reply.ok.payload.to_string())["locators"]
            if told or not endpoint.endswith(":0"):
                return session, str((told or [endpoint])[0])  # over ws/ it tells of none
    session.close()
    raise BusError(
        f"cannot listen on {endpoint}: the router does not say which port it took; choose one"
    )


def open_client(
    endpoint: str, timeout_s: float, options: SessionOptions = BY_DEFAULT
) -> zenoh.Session:
    """A client session to the router at `endpoint`; waits for it up to the time-out.

    Raises:
        BusError: the endpoint or the file of zenoh's is no good, or no router answers there.

    """
    if options.identity is not None:
        endpoint = tls_endpoint(endpoint)
    settings, file = _client_settings(endpoint, options), options.zenoh_config
    failure = (
        f"no zenoh router answers at {endpoint} within {timeout_s:g} s; start one there "
        "('fleet router'), or mend the endpoint"
    )

    def opened(within_s: float) -> zenoh.Session:
        limit = {_CONNECT_TIMEOUT: round(1000 * within_s)}
        return _open({**settings, **limit}, endpoint, failure, file)

    first_s = min(timeout_s, BEFORE_PROBE_S)
    try:
        return opened(first_s)
    except BusError as error:
        why = why_no_link(endpoint, options.identity)
        if why:
            raise BusError(why) from error
        if first_s == timeout_s:
            raise
    return opened(timeout_s - first_s)


def _client_settings(endpoint: str, options: SessionOptions) -> dict[str, Any]:
    secured = {} if options.identity is None else client_settings(options.identity)
    return {
        **_CLIENT,
        _LEASE: round(1e3 * options.lease_s),
        _PATIENCE: round(1e6 * options.patience_s),
        **secured,
        "connect/endpoints": [endpoint],
        _CONNECT_TIMEOUT: 60_000,
    }
