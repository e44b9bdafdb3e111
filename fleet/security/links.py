"""What zenoh must be told so that links are mutual TLS and a router lets only those rights pass."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from fleet.errors import BusError
from fleet.protocol.classes import DELIVERY_ORDER
from fleet.protocol.topics import ANY, key
from fleet.security.access import access_control
from fleet.security.identity import Identity

LONGEST_MESSAGE_BYTES = 4 << 20
"""A longer message is dropped by whoever receives it, with TLS or without."""
LONGEST_HEARD_BYTES = 64 << 10
"""A router with access control drops a longer one of what participants hear."""


def tls_endpoint(endpoint: str) -> str:
    """The endpoint with TLS; raises BusError for what is neither TCP nor TLS."""
    if re.match(r"(tcp|tls)/", endpoint):
        return re.sub(r"^tcp/", "tls/", endpoint)
    raise BusError(f"'{endpoint}' is no endpoint for --secure; write tls/ADDRESS:PORT")


def client_settings(identity: Identity) -> dict[str, Any]:
    """Settings of zenoh for a process that connects to a router."""
    return {
        "transport/link/tls": {
            "root_ca_certificate": str(identity.ca),
            "enable_mtls": True,
            "connect_certificate": str(identity.certificate),
            "connect_private_key": str(identity.key),
        }
    }


def router_settings(identity: Identity, uavs: Sequence[int], run: str = ANY) -> dict[str, Any]:
    """Settings of zenoh for a router of these UAVs, in one run or in all; also to link others."""
    return {
        "transport/link/tls": {
            **client_settings(identity)["transport/link/tls"],
            "listen_certificate": str(identity.certificate),
            "listen_private_key": str(identity.key),
        },
        "access_control": access_control(uavs, run),
        "low_pass_filter": [
            {
                "flows": ["ingress"],
                "messages": ["put"],
                "key_exprs": [key(run, f"*/{kind}/**") for kind in DELIVERY_ORDER],
                "size_limit": LONGEST_HEARD_BYTES,
            }
        ],
    }
