"""What would come of an encounter if nobody avoided anybody: each flies its plan alone.

Nobody is told anything under `resolver = "none"`, so that links, sensors and clocks change nothing,
and the paths are those of guidance. Only faults of processes do: who is unmanned flies straight on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from msgspec.structs import replace

from fleet.analysis.separation import PairMinimum, SeparationMonitor
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.faults.lifecycle import ProcessRule
from fleet.model.conflict.risk import Required
from fleet.model.types import Array
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder

ENCOUNTERS_KEPT = 512
"""So many encounters are remembered: those of a batch come again in each cell."""


@dataclass(frozen=True)
class Unavoided:
    """How near each pair would have come, nearest first: by what is required, and by the NMAC."""

    separation: tuple[PairMinimum, ...]
    nmac: tuple[PairMinimum, ...]


def unavoided(scenario: Scenario, nmac: Required) -> Unavoided:
    """The same as of a run with `resolver = "none"`."""
    process_faults = tuple(rule for rule in scenario.fault if isinstance(rule, ProcessRule))
    if process_faults:
        return _flown(replace(scenario, fault=process_faults, resolver="none"), nmac)
    return _by_plan(_what_flies(scenario), nmac)


def _what_flies(scenario: Scenario) -> Scenario:
    """A scenario of what matters to flights by plan alone, so that equal ones are flown once."""
    return Scenario(
        "unavoided",
        scenario.duration_s,
        seed=scenario.seed if scenario.generate else 0,
        tick_s=scenario.tick_s,
        zone=scenario.zone,
        performance=scenario.performance,
        guidance=scenario.guidance,
        uav=scenario.uav,
        generate=scenario.generate,
    )


@lru_cache(ENCOUNTERS_KEPT)
def _by_plan(scenario: Scenario, nmac: Required) -> Unavoided:
    uavs = uavs_of(scenario)
    ids = [uav.id for uav in uavs]
    paths = np.stack([planned_path(uav, scenario) for uav in uavs], axis=1)
    required, zones = scenario.required(), scenario.zone_ratios()
    monitors = (SeparationMonitor(ids, required, zones), SeparationMonitor(ids, nmac))
    for tick, positions in enumerate(paths):
        for monitor in monitors:
            monitor.update(tick * scenario.tick_ns, positions)
    return Unavoided(*(tuple(monitor.minima()) for monitor in monitors))


@lru_cache(ENCOUNTERS_KEPT)
def _flown(scenario: Scenario, nmac: Required) -> Unavoided:
    run_recorder = RunRecorder(scenario, None, nmac, digested=False)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    monitors = (run_recorder.separation, *run_recorder.others)
    return Unavoided(*(tuple(monitor.minima()) for monitor in monitors))


def planned_path(uav: Uav, scenario: Scenario) -> Array:
    """Where a UAV is at every tick of the scenario if it is told nothing: shape (ticks + 1, 3)."""
    pilot, state = scenario.pilot(uav.id, uav.speed_mps), uav.state()
    plan = pilot.advance(uav.plan(), state, state)
    places = [state.position_ned_m]
    for _ in range(scenario.ticks):
        plan, states = pilot.follow(plan, state, scenario.tick_ns)
        state = states[-1]
        places.append(state.position_ned_m)
    return np.array(places)
