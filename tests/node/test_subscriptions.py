"""Subscriptions go ahead of a participant, and nothing is waited for that may not come."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import cast

import pytest

from fleet.config.scenario import Scenario, Surveillance, Uav
from fleet.model.types import COORDINATOR
from fleet.model.words import ClockState
from fleet.node.gate import Gate
from fleet.node.intake import Taken
from fleet.node.subscriptions import SWEPT_TICKS, Subscriptions, listed_for
from fleet.protocol.codec import encode
from fleet.protocol.messages import Clock
from fleet.protocol.sample import Sample
from fleet.transport.zenoh_bus import Bus
from tests.support.samples import adsb

PLACES = {"0_0": (500.0, 500.0, -300.0), "0_1": (500.0, 1500.0, -300.0)}
SCENARIO = Scenario(
    "cells",
    10.0,
    surveillance=Surveillance(range_m=1000.0),
    uav=tuple(Uav(n, (0.0, 9000.0 * n, -300.0), 0.0, ((9e4, 0.0, -300.0),)) for n in (1, 2, 3)),
)


class NothingError(Exception):
    """It would wait for what does not come."""


class FakeBus:
    """Holds what was put, for who is subscribed then."""

    def __init__(self) -> None:
        self.there: dict[str, list[Sample]] = {}
        self.told: list[str] = []

    def listen(self, topic: str, *, own: bool) -> None:
        assert not own
        self.there[topic] = []
        self.told.append(f"+{topic}")

    def leave(self, topic: str) -> None:
        del self.there[topic]
        self.told.append(f"-{topic}")

    def waiting(self, topic: str) -> Iterator[Sample]:
        while self.there[topic]:
            yield self.there[topic].pop(0)

    def take(self, topic: str) -> Sample:
        if not self.there[topic]:
            raise NothingError
        return self.there[topic].pop(0)

    def put(self, uav: int, seq: int, cell: str) -> None:
        sample = Sample(f"{uav}/adsb/{cell}", encode(adsb(uav, seq=seq)), place=PLACES[cell])
        self.there.get(f"*/adsb/{cell}", []).append(sample)


def subscriptions(bus: FakeBus) -> Subscriptions:
    gate = Gate(SCENARIO)
    gate.latest_ns = 2**62
    return Subscriptions(cast("Bus", bus), 1, gate)


def grant(tick: int, **cells: tuple[tuple[int, int], ...]) -> Clock:
    """The manifest, by cells as a0_1."""
    expected = {f"adsb/{cell[1:]}": listed for cell, listed in cells.items()}
    return Clock(tick, tick * SCENARIO.tick_ns, ClockState.RUN, expected)


def seqs(taken: list[Taken]) -> dict[str, list[int]]:
    found = defaultdict(list)
    for sample, message in taken:
        found[sample.topic].append(message.seq)
    return dict(found)


def test_a_new_cell_is_waited_for_from_the_tick_after_the_one_that_subscribes() -> None:
    bus = FakeBus()
    own = subscriptions(bus)
    near, both = ["adsb/0_0"], ["adsb/0_0", "adsb/0_1"]
    own.want(near)
    assert own.take(None) == []
    own.want(both)  # in its step of tick 0, in which 3 may speak before the router knows
    assert seqs(own.take(grant(1, a0_1=((3, 0),)))) == {}
    own.want(both)
    bus.put(3, 1, "0_1")
    assert seqs(own.take(grant(2, a0_1=((3, 1),)))) == {"3/adsb/0_1": [1]}
    own.want(both)
    with pytest.raises(NothingError):
        own.take(grant(3, a0_1=((3, 2),)))
    assert {suffix: intake.lacking for suffix, intake in own.intakes.items()} == {
        "adsb/0_0": set(),
        "adsb/0_1": {(3, 2)},
    }


def test_a_cell_is_left_once_the_tick_is_served_in_which_it_was_within_reach() -> None:
    bus = FakeBus()
    own = subscriptions(bus)
    own.want(["adsb/0_0"])
    own.take(None)
    bus.put(2, 0, "0_0")
    own.want(["adsb/0_1"])
    assert seqs(own.take(grant(1, a0_0=((2, 0),)))) == {"2/adsb/0_0": [0]}
    assert bus.told == ["+*/adsb/0_0", "+*/adsb/0_1", "-*/adsb/0_0"]
    own.want(["adsb/0_1"])
    assert seqs(own.take(grant(2, a0_0=((2, 1),)))) == {}


def test_who_is_stopped_goes_on_to_take_from_the_cells_that_it_has() -> None:
    bus = FakeBus()
    own = subscriptions(bus)
    own.want(["adsb/0_0"])
    own.take(None)
    own.want(["adsb/0_1"])
    own.take(grant(1))
    for seq in (1, 2):  # it makes no step, so it wants nothing else
        bus.put(2, seq, "0_1")
        assert seqs(own.take(grant(1 + seq, a0_1=((2, seq),)))) == {"2/adsb/0_1": [seq]}


def test_who_turns_round_keeps_a_cell_that_it_was_about_to_leave() -> None:
    bus = FakeBus()
    own = subscriptions(bus)
    own.want(["adsb/0_0"])
    own.take(None)
    own.want(["adsb/0_1"])
    own.want(["adsb/0_0"])
    bus.put(2, 0, "0_0")
    assert seqs(own.take(grant(1, a0_0=((2, 0),)))) == {"2/adsb/0_0": [0]}
    assert bus.told[-1] == "-*/adsb/0_1"


def test_the_coordinator_takes_from_all_cells_and_nobody_its_own() -> None:
    clock = grant(1, a0_0=((1, 4), (2, 4)), a0_1=((3, 7),))
    assert listed_for(COORDINATOR, clock, "adsb/*") == [(1, 4), (2, 4), (3, 7)]
    assert listed_for(2, clock, "adsb/0_0") == [(1, 4)]


def test_what_is_never_listed_does_not_pile_up_on_the_bus() -> None:
    bus = FakeBus()
    own = subscriptions(bus)
    own.want(["adsb/0_0"])
    own.take(None)
    for tick in range(1, 5 * SWEPT_TICKS):
        bus.put(2, tick, "0_0")
        assert own.take(grant(tick)) == []
        assert len(bus.there["*/adsb/0_0"]) <= SWEPT_TICKS


def test_what_came_before_it_was_listed_is_there_when_it_is() -> None:
    bus = FakeBus()
    own = subscriptions(bus)
    own.want(["adsb/0_0"])
    own.take(None)
    for seq in (7, 8, 9):  # 7 is a stranger's word in the name of 2, 9 comes a tick early
        bus.put(2, seq, "0_0")
    for tick in range(1, SWEPT_TICKS + 1):
        assert own.take(grant(tick)) == []
    assert seqs(own.take(grant(SWEPT_TICKS + 1, a0_0=((2, 8),)))) == {"2/adsb/0_0": [8]}
    assert seqs(own.take(grant(SWEPT_TICKS + 2, a0_0=((2, 9),)))) == {"2/adsb/0_0": [9]}
