"""What came of a flight: separation, arrival, delay and commands, for benchmarks to share.

`undisturbed` flies every UAV by its plan alone. Nobody is told anything, so it is also what happens
under `resolver = "none"`, whatever the links do, and takes a hundredth of the time.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import msgspec
import numpy as np

from fleet.analysis.arrival import Arrivals
from fleet.analysis.separation import PairMinimum, SeparationMonitor
from fleet.config.scenario import Scenario, Uav
from fleet.model.conflict.risk import Required, first_overlap_s
from fleet.model.types import Array
from fleet.model.units import to_s
from fleet.protocol.messages import Command
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RecordSink, RunRecorder
from fleet.study.unavoided import unavoided
from fleet.transport.interface import ReceivedMessage

LOOK_TICKS = 50
"""So often it is asked whether all have arrived."""


@dataclass(frozen=True)
class Path:
    """One UAV's flight by its plan: times (n,), positions (n, 3), when each waypoint was reached.

    Waypoints that are not reached have no time.
    """

    times_s: Array
    positions_ned_m: Array
    reached_s: tuple[float, ...]


@dataclass(frozen=True)
class Separation:
    """Pairs that lost separation, and the least normalised separation of any pair."""

    lost: tuple[PairMinimum, ...]
    least: float


@dataclass(frozen=True)
class Outcome:
    """What came of a run; `commands` are those to each UAV, repetitions not counted."""

    separation: Separation
    arrivals: Arrivals
    commands: dict[int, int]
    unresolved: int

    @property
    def missing(self) -> list[int]:
        """UAVs whose aircraft is flown to the end, and has not arrived."""
        return [row.id for row in self.arrivals.flown if not row.arrived]


class Telling(RunRecorder):
    """A run recorder that notes whom how many commands were given to."""

    def __init__(self, scenario: Scenario, sink: RecordSink | None = None) -> None:
        super().__init__(scenario, sink, digested=False)
        self._told: set[tuple[int, int, int, int]] = set()

    def note(self, item: ReceivedMessage, log_ns: int) -> None:
        """Look at commands."""
        message = item[2]
        if isinstance(message, Command):
            self._told.add((message.target, message.term, message.id, message.number))
        super().note(item, log_ns)

    def outcome(self) -> Outcome:
        """What has come of the run so far."""
        told = Counter(target for target, *_ in self._told)
        arrivals = self.arrivals.arrivals()
        return Outcome(_of(self.separation), arrivals, dict(told), self.tally.unresolved)

    def all_arrived_since_s(self, now_ns: int) -> float:
        """How long ago the last UAV arrived; negative before that."""
        times = [row.arrival_s for row in self.arrivals.arrivals().rows]
        return min((to_s(now_ns) - t if t is not None else -1.0) for t in times)


def fly(scenario: Scenario, linger_s: float = math.inf) -> Outcome:
    """Fly it on the in-memory bus, to its end or until so long after the last arrival."""
    run_recorder = Telling(scenario)
    for tick, now_ns in enumerate(run_in_memory(scenario, run_recorder)):
        if tick % LOOK_TICKS == 0 and run_recorder.all_arrived_since_s(now_ns) > linger_s:
            break
    return run_recorder.outcome()


def path_of(uav: Uav, scenario: Scenario, until_s: float) -> Path:
    """Where a UAV is at every tick, if it is told nothing."""
    pilot, state = scenario.pilot(uav.id, uav.speed_mps), uav.state()
    plan = pilot.advance(uav.plan(), state, state)
    count = int(until_s / scenario.tick_s) + 1
    positions, reached = [state.position_ned_m], list[float]()
    for tick in range(1, count):
        plan, states = pilot.follow(plan, state, scenario.tick_ns)
        state = states[-1]
        positions.append(state.position_ned_m)
        reached += [tick * scenario.tick_s] * (plan.active - len(reached))
    times = np.linspace(0.0, (count - 1) * scenario.tick_s, count)
    return Path(times, np.array(positions), tuple(reached))


def first_loss_s(one: Path, two: Path, required: Required) -> float:
    """When two first lose separation; inf if they keep it."""
    relative = one.positions_ned_m - two.positions_ned_m
    return float(first_overlap_s(relative, one.times_s, required))


def undisturbed(scenario: Scenario, until_s: float = math.inf) -> Separation:
    """What separation there is if everybody flies by the plan alone."""
    until_s = min(until_s, scenario.duration_s)
    shorter = msgspec.structs.replace(scenario, duration_s=until_s, fault=())
    minima = unavoided(shorter, scenario.required()).separation
    least = min((minimum.least_separation for minimum in minima), default=math.inf)
    return Separation(tuple(m for m in minima if m.lost), least)


def _of(monitor: SeparationMonitor) -> Separation:
    return Separation(tuple(m for m in monitor.minima() if m.lost), monitor.least())
