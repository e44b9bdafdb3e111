"""Why a router does not answer: the TLS handshake is tried again where it can be looked at.

zenoh says of a refused certificate, on either side, no more than that the time is over.
"""

from __future__ import annotations

import re
import socket
import ssl

from fleet.security.identity import Identity

CONNECT_S = 2.0
REFUSAL_S = 1.0
"""A router that does not like the certificate says so after the handshake, within this time."""

NO_TLS = "does not speak TLS; start it with --secure, or drop --secure here"

_WRONG_NAME = (62, 64)
_UNKNOWN_CA = (7, 18, 19, 20, 21)
_EXPIRED, _NOT_YET_VALID = 10, 9
_WRONG_PURPOSE = 26
"""Codes of verification of OpenSSL."""


def why_no_link(endpoint: str, identity: Identity | None) -> str:
    """What is wrong between this process and whoever listens there; empty if nothing is known."""
    found = re.fullmatch(r"(tcp|tls)/\[?([^#?]+?)\]?:(\d+)(?:[#?].*)?", endpoint)
    if not found or (found[1] == "tls") != (identity is not None):
        return ""  # with certificates in the endpoint itself, or another protocol
    host, port = found[2], int(found[3])
    try:
        with socket.create_connection((host, port), timeout=CONNECT_S) as link:
            if identity is None:
                return _wants_tls(link, endpoint)
            return _shaken(link, host, endpoint, identity)
    except OSError:
        return ""  # nobody is there


def _wants_tls(link: socket.socket, endpoint: str) -> str:
    """Whether it is TLS that is spoken there, to a process that would not."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with context.wrap_socket(link):
            return f"the router at {endpoint} takes TLS alone; give --secure DIR"
    except OSError:
        return ""


def _shaken(link: socket.socket, host: str, endpoint: str, identity: Identity) -> str:
    router = f"the router at {endpoint}"
    context = ssl.create_default_context(cafile=identity.ca)
    context.load_cert_chain(identity.certificate, identity.key)
    shaken = False
    try:
        with context.wrap_socket(
            link, server_hostname=host, do_handshake_on_connect=False
        ) as secured:
            secured.do_handshake()
            shaken = True
            secured.settimeout(REFUSAL_S)
            secured.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"{router} shows a certificate {_verification(error, host, identity)}"
    except ssl.SSLError as error:
        return f"{router} {_alert(str(error.reason or error), identity)}"
    except OSError:  # after the handshake it waits for us to go on: the certificates are good
        return "" if shaken else f"{router} {NO_TLS}"
    return ""


def _verification(error: ssl.SSLCertVerificationError, host: str, identity: Identity) -> str:
    code = error.verify_code
    if code in _WRONG_NAME:
        return f"that is not for '{host}'; make one with 'fleet certs DIR --host {host}'"
    if code in _UNKNOWN_CA:
        return f"that {identity.ca} has not signed: it is of another fleet, or its own authority"
    if code == _EXPIRED:
        return "that has expired; make it a new one"
    if code == _NOT_YET_VALID:
        return "that is not valid yet; is a clock wrong?"
    if code == _WRONG_PURPOSE:
        return "that is not one of a router"
    return f"that is not accepted ({error.verify_message})"


def _alert(reason: str, identity: Identity) -> str:
    own = f"does not accept {identity.certificate}"
    told = reason.upper().replace(" ", "_")
    if "UNKNOWN_CA" in told or "DECRYPT_ERROR" in told:
        return f"{own}: its authority is another one"
    if "EXPIRED" in told:
        return f"{own}: it has expired there; is a clock wrong?"
    if "ALERT" in told:
        return f"{own} ({reason.lower().replace('_', ' ')})"
    return NO_TLS
