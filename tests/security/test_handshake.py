"""Why there is no link, found by a handshake that can be looked at."""

from __future__ import annotations

import socket
import ssl
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from fleet.security.certificates import make_certificates
from fleet.security.handshake import why_no_link
from fleet.security.identity import Identity


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Certificates of two fleets, `one` and `two`."""
    folder = tmp_path_factory.mktemp("certs")
    for name in ("one", "two"):
        make_certificates(folder / name, [1], [], 1.0, time.time())
    return folder


@contextmanager
def server(folder: Path, name: str, *, trusts: Path | None = None) -> Iterator[int]:
    """Shakes hands once with this certificate, and waits for more as zenoh does; on which port."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / f"{name}.pem", folder / f"{name}.key")
    context.load_verify_locations((trusts or folder) / "ca.pem")
    context.verify_mode = ssl.CERT_REQUIRED
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            with suppress(OSError):
                link, _ = listening.accept()
                with context.wrap_socket(link, server_side=True) as secured:
                    secured.recv(1)

        thread = threading.Thread(target=serve)
        thread.start()
        yield int(listening.getsockname()[1])
        thread.join()


def told(port: int, identity: Identity | None, host: str = "127.0.0.1") -> str:
    protocol = "tls" if identity else "tcp"
    return why_no_link(f"{protocol}/{host}:{port}", identity)


def test_nothing_is_said_where_all_is_well(certs: Path) -> None:
    with server(certs / "one", "router") as port:
        assert told(port, Identity(certs / "one", "uav-1")) == ""


def test_a_router_of_another_fleet_is_named(certs: Path) -> None:
    with server(certs / "two", "router") as port:
        assert "has not signed" in told(port, Identity(certs / "one", "uav-1"))


def test_a_router_under_another_name_is_named(certs: Path) -> None:
    with server(certs / "one", "router") as port:
        found = told(port, Identity(certs / "one", "uav-1"), "127.0.0.2")
        assert found == ""  # nobody listens there
        found = told(port, Identity(certs / "one", "uav-1"), "0")
        assert "is not for '0'; make one with 'fleet certs DIR --host 0'" in found


def test_a_uav_that_listens_is_no_router(certs: Path) -> None:
    with server(certs / "one", "uav-1") as port:
        assert "not one of a router" in told(port, Identity(certs / "one", "uav-1"))


def test_a_router_that_trusts_another_authority_is_named(certs: Path) -> None:
    with server(certs / "one", "router", trusts=certs / "two") as port:
        found = told(port, Identity(certs / "one", "uav-1"))
        assert "does not accept" in found
        assert "its authority is another one" in found


def test_an_open_client_is_told_that_tls_is_needed(certs: Path) -> None:
    with server(certs / "one", "router") as port:
        assert "takes TLS alone; give --secure DIR" in told(port, None)


def test_a_router_without_tls_is_named(certs: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def hang_up() -> None:
            listening.accept()[0].close()

        thread = threading.Thread(target=hang_up)
        thread.start()
        found = told(listening.getsockname()[1], Identity(certs / "one", "uav-1"))
        thread.join()
    assert "does not speak TLS" in found


def test_nobody_there_and_other_protocols_are_left_to_the_bus(certs: Path) -> None:
    assert told(1, Identity(certs / "one", "uav-1")) == ""
    assert why_no_link("udp/127.0.0.1:7447", None) == ""
    assert why_no_link("tls/127.0.0.1:7447#root_ca_certificate_file=x", None) == ""
