"""The in-memory bus: the same stations in one process, for studies and fast tests."""

from __future__ import annotations

from collections.abc import Iterator

from agents.agent import Agent
from agents.resolvers import load_resolver
from coordinator.coordinator import Coordinator
from fleet.comms import codec
from fleet.comms.keys import is_broadcast, suffix_of
from fleet.comms.messages import Clock
from fleet.comms.participant import lockstep_station
from fleet.comms.station import Node, Station
from fleet.model.generate import uavs_of
from fleet.model.scenario import Scenario
from fleet.run.clocks import FleetStoppedError
from fleet.run.ledger import Item, Ledger, expected_counts


def stations_of(scenario: Scenario) -> list[Station]:
    """The coordinator's station and one for each UAV."""
    nodes: list[Node] = [Agent(u, scenario, load_resolver(scenario)) for u in uavs_of(scenario)]
    return [lockstep_station(n, scenario) for n in [Coordinator(scenario), *nodes]]


def run_in_memory(scenario: Scenario, ledger: Ledger) -> Iterator[int]:
    """Run a scenario tick by tick, yielding each tick's simulated time once it is in the ledger."""
    stations = stations_of(scenario)
    hearers: dict[str, list[Station]] = {}
    for station in stations:
        for suffix in station.node.hears:
            hearers.setdefault(suffix, []).append(station)
    expected: dict[str, int] = {}
    for tick in range(scenario.ticks + 1):
        now_ns = tick * scenario.tick_ns
        clock = Clock(tick, now_ns, "run", expected)
        ledger.clock(clock, codec.encode(clock))
        items: list[Item] = []
        for station in stations:
            items += _stepped(station, tick, now_ns)
        for topic, payload, message in items:
            broadcast = is_broadcast(suffix_of(topic))
            for station in hearers.get(suffix_of(topic), ()):
                if not broadcast or station.node.id != message.id:
                    station.accept(topic, payload, message=message)
        expected = expected_counts(items)
        ledger.close(tick, now_ns, items)
        yield now_ns


def _stepped(station: Station, tick: int, now_ns: int) -> list[Item]:
    """What a station sends in a tick; its errors end the run as the death of a process would."""
    try:
        sent = station.step(now_ns)
        sent.append(station.done(tick, now_ns, sent))
        return [(topic, payload, codec.decode(topic, payload)) for topic, payload in sent]
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        raise FleetStoppedError(f"process {station.name} failed ({why})") from error
