"""Who arrived, when, how late, and whether all are back on their plans: one account of it.

The same class listens to a run that is on and to its log.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from fleet.analysis.planned import Planned, Plans, Tolerance, deviations
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.model.units import to_s
from fleet.model.words import AS_PLANNED, Mode
from fleet.protocol.messages import Ack, Message, Truth

FlownBy = Literal["flown", "unmanned", "vanished", "unseen"]
"""What a UAV is at its end: its process killed it is unmanned; unseen has no true state at all."""

"""Modes of a UAV that flies its plan."""
ARRIVAL_BLOCK = 512
"""So many places wait to be compared with the plan."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """One UAV. Times are those of the first tick after it; None is what has not happened.

    `planned_arrival_s` is that of the undisturbed flight (None: not within the scenario, or long
    after what is on record), and a UAV is due if that is within the run and its aircraft is still
    flown. What is unmanned passes its waypoints, but does not arrive. `back_on_plan` says whether
    it is within the tolerance of its plan at the end, and `back_on_plan_s` since when: None if it
    is not, or has never been off it, so that "back" with no time is one that never left.
    """

    id: int
    aircraft: FlownBy
    arrived: bool
    arrival_s: float | None
    planned_arrival_s: float | None
    due: bool
    delay_s: float | None
    back_on_plan: bool
    back_on_plan_s: float | None


@dataclass(frozen=True)
class Arrivals:
    """All UAVs of a run, in order."""

    rows: tuple[Arrival, ...]

    @property
    def flown(self) -> list[Arrival]:
        """Those whose aircraft are flown to the end; of others nobody expects to arrive."""
        return [row for row in self.rows if row.aircraft == "flown"]

    @property
    def missing(self) -> list[int]:
        """Who was due and has not arrived."""
        return [row.id for row in self.rows if row.due and not row.arrived]

    @property
    def all_arrived(self) -> Literal["yes", "no", "not due"]:
        """Whether all arrived that are flown; not due: some would not by the plan alone, either."""
        if self.missing:
            return "no"
        flown = self.flown
        return "yes" if flown and all(row.arrived for row in flown) else "not due"

    @property
    def delays_s(self) -> list[float]:
        """How much later than undisturbed those arrived that did."""
        return [row.delay_s for row in self.rows if row.delay_s is not None]

    @property
    def delay_mean_s(self) -> float | None:
        """Mean of the delays."""
        return float(np.mean(self.delays_s)) if self.delays_s else None

    @property
    def delay_max_s(self) -> float | None:
        """Greatest of the delays."""
        return max(self.delays_s, default=None)

    def totals(self) -> dict[str, Any]:
        """All together, by the names that results and metrics give to it."""
        return {
            "all_arrived": self.all_arrived,
            "arrived": sum(row.arrived for row in self.rows),
            "due": sum(row.due for row in self.rows),
            "not_arrived": tuple(self.missing),
            "delay_mean_s": self.delay_mean_s,
            "delay_max_s": self.delay_max_s,
        }


@dataclass
class _Watch:
    """What is known of one UAV so far."""

    uav: Uav
    arrival_ns: int | None = None
    last_ns: int = -1
    recorded: int = 0
    mode: str = ""
    disturbed: bool = False
    off: bool = False
    back_ns: int | None = None
    times_ns: list[int] = field(default_factory=list)
    places: list[tuple[float, float, float]] = field(default_factory=list)


class ArrivalMonitor:
    """Fed true states and acknowledgements, those of each UAV in order of time.

    The undisturbed flight of a UAV is flown again only if a command or a fault has disturbed it:
    till then it is its own. Its distance from the plan is looked at from then on.
    """

    def __init__(self, scenario: Scenario, tolerance: Tolerance | None = None) -> None:
        self._plans = Plans(scenario)
        self._tolerance = tolerance or Tolerance()
        self._watches = {uav.id: _Watch(uav) for uav in uavs_of(scenario)}
        self._tick_ns = scenario.tick_ns
        self._farthest_m = 0.0

    def add(self, message: Message) -> None:
        """Take in a message."""
        watch = self._watches.get(message.id)
        if watch is None:
            return
        if isinstance(message, Truth):
            self._follow(watch, message)
        elif isinstance(message, Ack) and message.accepted:
            watch.disturbed = True

    def _follow(self, watch: _Watch, truth: Truth) -> None:
        watch.last_ns, watch.mode = truth.t_ns, truth.mode
        watch.recorded += 1
        there = truth.waypoint_index >= len(watch.uav.waypoints_ned_m)
        if there and watch.arrival_ns is None and truth.mode != Mode.UNMANNED:
            watch.arrival_ns = truth.t_ns
        watch.disturbed |= truth.mode not in AS_PLANNED
        if watch.disturbed:
            watch.times_ns.append(truth.t_ns)
            watch.places.append(truth.position_ned_m)
            if len(watch.places) >= ARRIVAL_BLOCK:
                self._compare(watch)

    def _compare(self, watch: _Watch) -> None:
        """Whether the places that wait are on the plan."""
        if not watch.places:
            return
        corners = self._plan(watch).corners
        path_m, altitude_m = deviations(corners, np.array(watch.places))
        self._farthest_m = max(self._farthest_m, float(path_m.max()))
        off = self._tolerance.off(path_m, altitude_m)
        for t_ns, now in zip(watch.times_ns, off.tolist(), strict=True):
            if now:
                watch.back_ns = None
            elif watch.off:
                watch.back_ns = t_ns
            watch.off = now
        watch.times_ns.clear()
        watch.places.clear()

    def arrivals(self) -> Arrivals:
        """What has come of it so far."""
        end_ns = max((watch.last_ns for watch in self._watches.values()), default=-1)
        return Arrivals(tuple(self._arrival(watch, end_ns) for watch in self._watches.values()))

    def _arrival(self, watch: _Watch, end_ns: int) -> Arrival:
        self._compare(watch)
        planned_ns = watch.arrival_ns
        if watch.disturbed:
            planned_ns = self._plan(watch).arrival_ns
        aircraft = self._aircraft(watch, end_ns)
        due = aircraft == "flown" and planned_ns is not None and planned_ns <= end_ns
        both = watch.arrival_ns is not None and planned_ns is not None
        return Arrival(
            watch.uav.id,
            aircraft,
            watch.arrival_ns is not None,
            _seconds(watch.arrival_ns),
            _seconds(planned_ns),
            due,
            to_s((watch.arrival_ns or 0) - (planned_ns or 0)) if both else None,
            not watch.off,
            _seconds(watch.back_ns),
        )

    @property
    def path_deviation_max_m(self) -> float:
        """The greatest horizontal distance of any UAV from its planned path so far.

        At each tick since a command or a fault first disturbed it; 0 for one that none has.
        """
        for watch in self._watches.values():
            self._compare(watch)
        return self._farthest_m

    def planned(self, uav: int) -> Planned:
        """The undisturbed flight of a UAV, beyond what is on record of it."""
        return self._plan(self._watches[uav])

    def _plan(self, watch: _Watch) -> Planned:
        return self._plans.of(watch.uav, watch.recorded)

    def _aircraft(self, watch: _Watch, end_ns: int) -> FlownBy:
        if watch.last_ns < 0:
            return "unseen"
        if watch.mode == Mode.UNMANNED:
            return "unmanned"
        return "vanished" if watch.last_ns < end_ns - self._tick_ns else "flown"


def _seconds(t_ns: int | None) -> float | None:
    return None if t_ns is None else to_s(t_ns)
