"""The in-memory bus: the same stations in one process, for studies and fast tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec

from agents.agent import Agent
from agents.resolvers import load_resolver
from coordinator.coordinator import Coordinator
from fleet.comms import codec
from fleet.comms.arrival import Place
from fleet.comms.keys import is_broadcast, suffix_of
from fleet.comms.messages import COORDINATOR, HEARD
from fleet.comms.participant import lockstep_station
from fleet.comms.station import Node, Revival, Station
from fleet.model.faults.plan import FaultRule
from fleet.model.faults.process import Change
from fleet.model.generate import participants, uavs_of
from fleet.model.scenario import Scenario
from fleet.run.cast import Cast
from fleet.run.ear import FleetStoppedError
from fleet.run.ledger import Item, Ledger, Manifest, manifest


class Stations:
    """The stations of a run by number; they come and go with the process faults."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._uavs = {u.id: u for u in uavs_of(scenario)}
        self.present = {n: self._station(n, None) for n in participants(scenario)}

    def carry_out(self, change: Change, revival: Revival | None) -> None:
        """Let a station die or come again; a held one is merely not stepped."""
        if change.action == "kill":
            self.present.pop(change.node, None)
        elif change.action == "restart":
            self.present[change.node] = self._station(change.node, revival)

    def replan(self, plan: tuple[FaultRule, ...]) -> None:
        """Everybody goes by another fault plan."""
        self._scenario = msgspec.structs.replace(self._scenario, fault=plan)
        for station in self.present.values():
            station.replan(plan)

    def hand_out(self, item: Item, place: Place | None) -> None:
        """Bring a message to everybody who hears its topic."""
        topic, payload, message = item
        suffix = suffix_of(topic)
        broadcast = is_broadcast(suffix)
        for number, station in self.present.items():
            if suffix in station.node.hears and not (broadcast and number == message.id):
                station.accept(topic, payload, message, place=place)

    def _station(self, number: int, revival: Revival | None) -> Station:
        scenario = self._scenario
        node: Node
        if number == COORDINATOR:
            node = Coordinator(scenario, revival)
        else:
            node = Agent(self._uavs[number], scenario, load_resolver(scenario), revival)
        return lockstep_station(node, scenario, revival)


NewPlan = Callable[[tuple[FaultRule, ...], int], tuple[FaultRule, ...] | None]
"""Given the plan so far and the tick: the plan from that tick on, or None if it stays."""


def run_in_memory(
    scenario: Scenario, ledger: Ledger, new_plan: NewPlan | None = None
) -> Iterator[int]:
    """Run a scenario tick by tick, yielding each tick's simulated time once it is in the ledger."""
    stations, cast = Stations(scenario), Cast(scenario)
    listed: Manifest = {}
    for tick in range(scenario.ticks + 1):
        now_ns = tick * scenario.tick_ns
        plan = new_plan(cast.plan, tick) if new_plan else None
        if plan is not None:
            stations.replan(plan)
        for change, revival in cast.enter(tick, plan):
            stations.carry_out(change, revival)
        clock = cast.clock(tick, listed, new_plan=plan is not None)
        ledger.clock(clock, codec.encode(clock))
        items, places = list[Item](), list[Place | None]()
        for number, station in stations.present.items():
            if number not in clock.held:
                sent = _stepped(station, tick, now_ns)
                items += sent
                places += [station.place] * len(sent)
        for item, place in zip(items, places, strict=True):
            if item[2].kind in HEARD:
                stations.hand_out(item, place)
        listed = manifest(items)
        cast.note(item[2] for item in items)
        items += cast.unmanned(tick)
        ledger.vanished = cast.vanished(tick)
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
