"""What came of a flight: separation, arrival, delay and commands, for benchmarks to share.

`undisturbed` flies every UAV by its plan alone. Nobody is told anything, so it is also what happens
under `resolver = "none"`, whatever the links do, and takes a hundredth of the time.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from agents.vehicle import Vehicle
from fleet.analysis.separation import PairMinimum, SeparationMonitor
from fleet.comms.messages import Cmd, Truth
from fleet.model.generate import uavs_of
from fleet.model.risk import Required, first_overlap_s
from fleet.model.scenario import Scenario, Uav
from fleet.model.trajectory import Array
from fleet.model.units import to_s
from fleet.run.ledger import Item, Ledger, Sink
from fleet.run.memory import run_in_memory


@dataclass(frozen=True)
class Path:
    """One UAV's flight by its plan: times (n,), positions (n, 3), when each waypoint was reached.

    Waypoints that are not reached have no time.
    """

    times_s: Array
    positions_ned_m: Array
    reached_s: tuple[float, ...]


@dataclass(frozen=True)
class Outcome:
    """What came of a run.

    Pairs that lost separation, the least normalised separation, and for each UAV when it reached
    its last waypoint (inf: never) and how many commands it was given, repetitions not counted.
    """

    lost: tuple[PairMinimum, ...]
    least_separation: float
    arrival_s: dict[int, float]
    commands: dict[int, int] = field(default_factory=dict)
    unresolved: int = 0

    @property
    def missing(self) -> list[int]:
        """UAVs that have not reached their last waypoint."""
        return [uav for uav, at_s in self.arrival_s.items() if math.isinf(at_s)]

    def delays_s(self, undisturbed: Outcome) -> dict[int, float]:
        """How much later than undisturbed each UAV arrived that did."""
        return {
            uav: at_s - undisturbed.arrival_s[uav]
            for uav, at_s in self.arrival_s.items()
            if not math.isinf(at_s)
        }


class Arrivals(Ledger):
    """A ledger that notes when each UAV reached its last waypoint, and what it was told."""

    def __init__(self, scenario: Scenario, sink: Sink | None = None) -> None:
        super().__init__(scenario, sink)
        self._last = {u.id: len(u.waypoints_ned_m) for u in uavs_of(scenario)}
        self.arrival_s = dict.fromkeys(self._last, math.inf)
        self._told: set[tuple[int, int, int, int]] = set()

    def note(self, item: Item, log_ns: int) -> None:
        """Look at true states and commands."""
        message = item[2]
        if isinstance(message, Truth) and message.waypoint_index >= self._last[message.id]:
            at_s = min(self.arrival_s[message.id], to_s(message.t_ns))
            self.arrival_s[message.id] = at_s
        elif isinstance(message, Cmd):
            self._told.add((message.target, message.term, message.id, message.number))
        super().note(item, log_ns)

    def outcome(self) -> Outcome:
        """What has come of the run so far."""
        return Outcome(
            _lost(self.separation),
            self.separation.least(),
            self.arrival_s,
            Counter(target for target, *_ in self._told),
            self.tally.unresolved,
        )


def fly(scenario: Scenario, linger_s: float = math.inf) -> Outcome:
    """Fly it on the in-memory bus, to its end or until so long after the last arrival."""
    ledger = Arrivals(scenario)
    for now_ns in run_in_memory(scenario, ledger):
        if to_s(now_ns) > max(ledger.arrival_s.values()) + linger_s:
            break
    return ledger.outcome()


def path_of(uav: Uav, scenario: Scenario, until_s: float) -> Path:
    """Where a UAV is at every tick, if it is told nothing."""
    vehicle = Vehicle(uav, scenario)
    count = int(until_s / scenario.tick_s) + 1
    positions, reached = [], list[float]()
    for tick in range(count):
        vehicle.fly_to(tick * scenario.tick_ns)
        positions.append(vehicle.state.position_ned_m)
        reached += [to_s(vehicle.now_ns)] * (vehicle.plan.active - len(reached))
    times = np.linspace(0.0, (count - 1) * scenario.tick_s, count)
    return Path(times, np.array(positions), tuple(reached))


def first_loss_s(one: Path, two: Path, required: Required) -> float:
    """When two first lose separation; inf if they keep it."""
    relative = one.positions_ned_m - two.positions_ned_m
    return float(first_overlap_s(relative, one.times_s, required))


def undisturbed(scenario: Scenario, until_s: float = math.inf) -> Outcome:
    """Everybody's flight by the plan alone."""
    uavs = uavs_of(scenario)
    until_s = min(until_s, scenario.duration_s)
    paths = [path_of(u, scenario, until_s) for u in uavs]
    monitor = SeparationMonitor([u.id for u in uavs], scenario.required())
    for tick, positions in enumerate(np.stack([p.positions_ned_m for p in paths], axis=1)):
        monitor.update(tick * scenario.tick_ns, positions)
    arrival_s = {
        u.id: p.reached_s[-1] if len(p.reached_s) == len(u.waypoints_ned_m) else math.inf
        for u, p in zip(uavs, paths, strict=True)
    }
    return Outcome(_lost(monitor), monitor.least(), arrival_s)


def _lost(monitor: SeparationMonitor) -> tuple[PairMinimum, ...]:
    return tuple(m for m in monitor.minima() if m.least_separation < 1.0)
