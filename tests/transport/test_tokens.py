"""Who ends without whom: a token that has gone, and one that vanishes while a link is renewed."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from fleet.transport import zenoh_bus
from fleet.transport.zenoh_bus import Bus, open_client_bus, open_router_bus

WITHIN_S = 20.0
"""No test waits so long; it is what a busy machine may take."""


@pytest.fixture
def endpoint() -> Iterator[str]:
    bus, where = open_router_bus("a-run", "router", "tcp/127.0.0.1:0")
    with bus:
        yield where


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Set, and no more, where a process would end."""
    found = threading.Event()
    monkeypatch.setattr(Bus, "_leave", lambda *_, **__: found.set())
    return found


def simulation(endpoint: str) -> Bus:
    bus = open_client_bus("a-run", "sim", endpoint)
    bus.announce()
    return bus


def waiting() -> list[threading.Thread]:
    return [t for t in threading.enumerate() if t.name == "without sim"]


def test_one_that_is_there_again_has_not_gone(
    endpoint: str, ended: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a silence, when zenoh takes a new link: all tokens vanish, and are there again."""
    vanished, there = threading.Event(), threading.Event()
    monkeypatch.setattr(zenoh_bus, "RENEWED_S", WITHIN_S, raising=False)
    with open_client_bus("a-run", "1", endpoint) as uav:
        uav.watch(lambda _: vanished.set(), lambda _: there.set())
        with simulation(endpoint):
            uav.end_without("sim", patience_s=WITHIN_S)
            assert there.wait(WITHIN_S)
        assert vanished.wait(WITHIN_S)
        with simulation(endpoint):
            for thread in waiting():
                thread.join(WITHIN_S)
            assert not ended.is_set()


def test_one_that_does_not_come_back_has_gone(endpoint: str, ended: threading.Event) -> None:
    there = threading.Event()
    with open_client_bus("a-run", "1", endpoint) as uav:
        uav.watch(lambda _: None, lambda _: there.set())
        uav.end_without("sim")
        with simulation(endpoint):
            assert there.wait(WITHIN_S)
        assert ended.wait(WITHIN_S)
