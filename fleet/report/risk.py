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

from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.tracks import StateReport
from fleet.model.types import Array, Pair
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import Pilot
from fleet.model.vehicle.intent import Intent
from fleet.model.words import AVOIDING, UNMANNED
from fleet.protocol.surveillance import manoeuvre_of
from fleet.report.curves import Interval, intervals
from fleet.report.run_data import Flight, RunData

RISK_SAMPLES = {10: 2000, 1_000_000: 600}
"""At most so many moments are looked at in fleets of up to so many UAVs."""


@dataclass(frozen=True)
class Risk:
    """When a pair is at risk: as both fly, and as they would if guidance were followed too."""

    flown: list[Interval]
    planned: list[Interval]


def risks(run_data: RunData) -> dict[Pair, Risk]:
    """The pairs that are ever at risk, lower number first, in order of when they are."""
    times = run_data.times_s[:: _stride(run_data)]
    flown: dict[Pair, NDArray[np.bool_]] = {}
    planned: dict[Pair, NDArray[np.bool_]] = {}
    outlook = run_data.scenario.outlook()
    for n, time_s in enumerate(times):
        reports = reports_at(run_data, run_data.at(float(time_s)))
        as_planned = conflicts(reports, 0, outlook)
        as_flown = as_planned
        if any(r.manoeuvre for r in reports):
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


def _stride(run_data: RunData) -> int:
    """In ticks: the coordinator's period, or longer if there would be too many samples."""
    scenario = run_data.scenario
    most = next(m for uavs, m in RISK_SAMPLES.items() if len(run_data.flights) <= uavs)
    period = round(scenario.coordination.update_s / scenario.tick_s)
    return max(1, period, math.ceil(len(run_data.times_s) / most))


def reports_at(run_data: RunData, place: int) -> list[StateReport]:
    """What every UAV that is there would report if it sensed and told the truth."""
    there = [f for f in run_data.flights if np.isfinite(f.ned_m[place, 0])]
    return [report_at(f, place, run_data.scenario.pilot(f.id, f.uav.speed_mps)) for f in there]


def report_at(flight: Flight, place: int, pilot: Pilot) -> StateReport:
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
    mode, manoeuvre = str(flight.modes[place]), None
    plan = flight.uav.plan(int(flight.waypoints[place]))
    if mode in UNMANNED:
        held = flight.uav.speed_mps if math.isnan(speed) else speed
        guidance = Intent(heading, climb, speed_mps=held)
    else:
        guidance = pilot.intent(plan, state)
        manoeuvre = manoeuvre_of(mode, heading, climb, down_m, speed) if mode in AVOIDING else None
    return StateReport(flight.id, 0, state, guidance, plan, manoeuvre)


def _bound(report: StateReport) -> StateReport:
    """The same UAV if it flew its manoeuvre for ever."""
    return msgspec.structs.replace(report, guidance=report.intent(), manoeuvre=None)
