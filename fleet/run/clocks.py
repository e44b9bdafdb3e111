"""The two clocks, as the range conducts them: lockstep and realtime."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

from fleet.comms import codec
from fleet.comms.keys import ABORT, CLOCK, EVERYTHING, issuer_of, topic_of
from fleet.comms.messages import Clock, Done
from fleet.comms.zenoh_bus import Arrival, Bus
from fleet.model.scenario import Scenario
from fleet.run.ledger import Item, Ledger, expected_counts

EPOCH_LEAD_NS = 200_000_000
"""Realtime begins this long after everybody is ready, so that all have heard when."""

LAST_WORDS_NS = 2_000_000_000
"""How long after the last realtime tick the range waits for everybody's last messages."""


class FleetStoppedError(Exception):
    """The run cannot go on; the message says who and why."""


class Roll:
    """Who has been heard of, for whoever has to say whom the range waits for; `busy` if it does."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = frozenset(names)
        self.waiting: set[str] = set(names)
        self.moved_s = time.monotonic()
        self.busy = True

    def expect_all(self) -> None:
        """A new tick: everybody is awaited."""
        self.waiting = set(self.names)
        self.moved_s = time.monotonic()
        self.busy = True

    def heard(self, name: str) -> None:
        """One of them has reported."""
        self.waiting.discard(name)


def decoded(arrival: Arrival, roll: Roll) -> Item | None:
    """A participant's message; None for the range's own clock and for those of strangers.

    Raises:
        FleetStoppedError: it is an abort, or a participant's message is malformed.

    """
    if arrival.topic == ABORT:
        raise FleetStoppedError(arrival.payload.decode(errors="replace"))
    if issuer_of(arrival.topic) not in roll.names:
        return None
    try:
        message = codec.decode(arrival.topic, arrival.payload)
    except ValueError as error:
        raise FleetStoppedError(f"malformed message on {arrival.topic}: {error}") from error
    if topic_of(message) != arrival.topic:
        raise FleetStoppedError(f"the message on {arrival.topic} belongs on {topic_of(message)}")
    return arrival.topic, arrival.payload, message


def conduct_lockstep(
    bus: Bus, scenario: Scenario, ledger: Ledger, roll: Roll, speed: float
) -> Iterator[int]:
    """Grant tick after tick, each once everything of the one before is there; yields their times.

    What a tick left is worked up while the participants are busy with the next one.
    """
    _collect(bus, roll)
    begun_s = time.monotonic()
    items: list[Item] = []
    for tick in range(scenario.ticks + 1):
        now_ns = tick * scenario.tick_ns
        if speed > 0.0:
            time.sleep(max(0.0, begun_s + now_ns / 1e9 / speed - time.monotonic()))
        roll.expect_all()
        clock = Clock(tick, now_ns, "run", expected_counts(items))
        payload = codec.encode(clock)
        bus.put(CLOCK, payload)
        if tick > 0:
            ledger.close(tick - 1, now_ns - scenario.tick_ns, items)
            yield now_ns - scenario.tick_ns
        ledger.clock(clock, payload)
        items = _collect(bus, roll)
    ledger.close(scenario.ticks, scenario.ticks * scenario.tick_ns, items)
    yield scenario.ticks * scenario.tick_ns
    _stop(bus, scenario.ticks, scenario.ticks * scenario.tick_ns)


def _collect(bus: Bus, roll: Roll) -> list[Item]:
    """All messages of one tick: until everybody is done and all that they sent has come."""
    items: list[Item] = []
    owed = 0
    while roll.waiting or owed > 0:
        item = decoded(bus.take(EVERYTHING), roll)
        if item is None:
            continue
        items.append(item)
        owed -= 1
        message = item[2]
        if isinstance(message, Done):
            if issuer_of(item[0]) not in roll.waiting:
                raise FleetStoppedError(f"process {issuer_of(item[0])} takes part twice")
            roll.heard(issuer_of(item[0]))
            owed += sum(message.sent.values()) + 1
    roll.busy = False
    return items


def conduct_realtime(bus: Bus, scenario: Scenario, ledger: Ledger, roll: Roll) -> Iterator[int]:
    """Set the epoch, then listen for as long as the run lasts; yields the time tick by tick."""
    while roll.waiting:
        item = decoded(_next(bus), roll)
        if item is not None:
            roll.heard(issuer_of(item[0]))
    epoch_ns = bus.now_unix_ns() + EPOCH_LEAD_NS
    clock = Clock(0, 0, "epoch", {}, epoch_ns)
    payload = codec.encode(clock)
    bus.put(CLOCK, payload)
    ledger.clock(clock, payload)
    roll.expect_all()
    for tick in range(scenario.ticks + 1):
        due_ns = epoch_ns + (tick + 1) * scenario.tick_ns
        while (arrival := bus.next_before(due_ns)) is not None:
            _note(arrival, epoch_ns, ledger, roll)
        roll.moved_s = time.monotonic()
        yield tick * scenario.tick_ns
    until_ns = bus.now_unix_ns() + LAST_WORDS_NS
    while roll.waiting and (arrival := bus.next_before(until_ns)) is not None:
        _note(arrival, epoch_ns, ledger, roll)
    if roll.waiting:
        raise FleetStoppedError(f"no last message from {', '.join(sorted(roll.waiting))}")
    _stop(bus, scenario.ticks, scenario.ticks * scenario.tick_ns)


def _note(arrival: Arrival, epoch_ns: int, ledger: Ledger, roll: Roll) -> None:
    item = decoded(arrival, roll)
    if item is None:
        return
    if isinstance(item[2], Done):
        roll.heard(issuer_of(item[0]))
    ledger.note(item, max(0, arrival.arrived_unix_ns - epoch_ns))


def _next(bus: Bus) -> Arrival:
    while True:
        arrival = bus.next_before(bus.now_unix_ns() + 1_000_000_000)
        if arrival is not None:
            return arrival


def _stop(bus: Bus, tick: int, t_ns: int) -> None:
    bus.put(CLOCK, codec.encode(Clock(tick, t_ns, "stop", {})))
