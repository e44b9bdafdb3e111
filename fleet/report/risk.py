"""The Boolean risk of each pair (eq. 9) against time, computed from the true states.

It uses the same function as the coordinator's alert, on what is true instead of what was heard: so
it can be drawn of any run, with or without a coordinator, with or without a resolver.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from fleet.comms.surveillance import escape_of
from fleet.model.aims import Aim
from fleet.model.flight import State
from fleet.model.groups import Pair, conflicts
from fleet.model.guidance import Pilot
from fleet.model.tracks import ESCAPES, Report
from fleet.model.trajectory import Array
from fleet.report.curves import Interval, intervals
from fleet.report.story import Flight, Story

SAMPLES = {10: 2000, 1_000_000: 600}
"""At most so many moments are looked at in fleets of up to so many UAVs."""


@dataclass(frozen=True)
class Risk:
    """When a pair is at risk: as both fly, and as they would if guidance were followed too."""

    flown: list[Interval]
    planned: list[Interval]


def risks(story: Story) -> dict[Pair, Risk]:
    """The pairs that are ever at risk, lower number first, in order of when they are."""
    times = story.times_s[:: _stride(story)]
    flown: dict[Pair, NDArray[np.bool_]] = {}
    planned: dict[Pair, NDArray[np.bool_]] = {}
    outlook = story.scenario.outlook()
    for n, time_s in enumerate(times):
        reports = reports_at(story, story.at(float(time_s)))
        as_planned = conflicts(reports, 0, outlook)
        as_flown = as_planned
        if any(r.escape for r in reports):
            as_flown = conflicts([_bound(r) for r in reports], 0, outlook)
        for found, seen in ((as_planned, planned), (as_flown, flown)):
            for pair in found:
                seen.setdefault(pair, np.zeros(len(times), dtype=np.bool_))[n] = True
    made = {
        pair: Risk(_closed(times, flown.get(pair)), intervals(times, flags))
        for pair, flags in planned.items()
    }
    return dict(sorted(made.items(), key=lambda item: (item[1].planned[0], item[0])))


def _closed(times_s: Array, flags: NDArray[np.bool_] | None) -> list[Interval]:
    return [] if flags is None else intervals(times_s, flags)


def _stride(story: Story) -> int:
    """In ticks: the coordinator's period, or longer if there would be too many samples."""
    scenario = story.scenario
    most = next(m for uavs, m in SAMPLES.items() if len(story.flights) <= uavs)
    period = round(scenario.coordination.update_s / scenario.tick_s)
    return max(1, period, math.ceil(len(story.times_s) / most))


def reports_at(story: Story, place: int) -> list[Report]:
    """What every UAV that is there would report if it sensed and told the truth."""
    there = [f for f in story.flights if np.isfinite(f.ned_m[place, 0])]
    return [report_at(f, place, story.scenario.pilot(f.uav.speed_mps)) for f in there]


def report_at(flight: Flight, place: int, pilot: Pilot) -> Report:
    """One UAV's report, as of time 0; without a pilot it holds its last command."""
    north, east, down = flight.ned_m[place].tolist()
    state = State(
        north,
        east,
        down,
        float(flight.speed_mps[place]),
        float(flight.heading_rad[place]),
        float(flight.flight_path_rad[place]),
    )
    heading, climb, down_m, speed = flight.commanded[place].tolist()
    mode, escape = str(flight.modes[place]), None
    plan = flight.uav.plan(int(flight.waypoints[place]))
    if mode in ("held", "unmanned"):
        held = flight.uav.speed_mps if math.isnan(speed) else speed
        guidance = Aim(heading, climb, speed_mps=held)
    else:
        guidance = pilot.aim(plan, state)
        escape = escape_of(mode, heading, climb, down_m, speed) if mode in ESCAPES else None
    return Report(flight.id, 0, state, guidance, plan, escape)


def _bound(report: Report) -> Report:
    """The same UAV if it flew its escape for ever."""
    return msgspec.structs.replace(report, guidance=report.aim(), escape=None)
