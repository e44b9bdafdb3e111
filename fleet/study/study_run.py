"""One run of a study, in memory: from cell and number to a row."""

from __future__ import annotations

from typing import Any, Literal

from msgspec.structs import replace

from fleet.agents.resolvers import load_resolver
from fleet.analysis.arrival import ArrivalMonitor
from fleet.analysis.separation import PairMinimum
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.errors import FleetStoppedError, ScenarioError
from fleet.model.conflict.risk import Required
from fleet.model.types import Pair
from fleet.protocol.classes import AUDIBLE
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from fleet.study.design import Cell
from fleet.study.encounters.encounter_kind import DrawnEncounter, fault_seed
from fleet.study.run_row import RunRow
from fleet.study.scenario_of_run import with_encounter
from fleet.study.study_file import Study
from fleet.study.unavoided import Unavoided, unavoided

StudyEvent = Literal["lost", "nmac"]
"""What a study counts runs by: loss of separation, or a near mid-air collision."""


def study_run(
    study: Study, cell: Cell, scenario: Scenario, run: int, drawn: DrawnEncounter
) -> RunRow:
    """Fly run number `run` of a cell, whose scenario this is, with its encounter.

    Whatever goes wrong in it is in the row, not raised.
    """
    row = RunRow(cell=cell.number, run=run, seed=fault_seed(study.seed, run), weight=drawn.weight)
    try:
        flown = with_encounter(study, cell, scenario, drawn, run)
        return replace(row, **outcome_of(flown, required_by(study)))
    except (ScenarioError, FleetStoppedError) as error:
        return replace(row, error=str(error))
    except Exception as error:  # noqa: BLE001 (whatever it is, it is what came of this run)
        return replace(row, error=f"{type(error).__name__}: {error}")


def required_by(study: Study) -> Required:
    """The distances of the study's NMAC volume."""
    return Required(study.nmac.horizontal_m, study.nmac.vertical_m)


def outcome_of(scenario: Scenario, nmac: Required) -> dict[str, Any]:
    """Fly a scenario in memory to its end: the columns of its row, from `digest` on."""
    load_resolver(scenario)
    run_recorder = RunRecorder(scenario, None, nmac)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    tally, latencies = run_recorder.tally, list(run_recorder.tally.applied.values())
    messages = run_recorder.messages
    return {
        "digest": run_recorder.digest,
        "uavs": len(uavs_of(scenario)),
        **_separation(run_recorder, unavoided(scenario, nmac)),
        **_arrival(run_recorder.arrivals),
        "commands": len(tally.issued),
        "transmissions": tally.transmissions,
        "command_latency_s": sum(latencies) / len(latencies) if latencies else None,
        "elections": len(tally.terms),
        "foreseen_losses": tally.unresolved,
        "messages": sum(messages[kind] for kind in AUDIBLE),
    }


def margin_of(scenario: Scenario, study: Study, event: StudyEvent) -> float:
    """Fly a scenario: the least separation by what an event needs, less 1; below 0 it happens."""
    load_resolver(scenario)
    run_recorder = RunRecorder(scenario, None, required_by(study), digested=False)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    monitor = run_recorder.separation if event == "lost" else run_recorder.others[0]
    return monitor.least() - 1.0


def _separation(run_recorder: RunRecorder, without: Unavoided) -> dict[str, Any]:
    minima, (nmac,) = run_recorder.separation.minima(), run_recorder.others
    lost, lost_without = _lost(minima), _lost(without.separation)
    out: dict[str, Any] = {
        "lost": bool(lost),
        "nmac": nmac.lost(),
        "lost_without": bool(lost_without),
        "nmac_without": bool(_lost(without.nmac)),
        "least_without": without.separation[0].least_separation if without.separation else None,
        "pairs_lost": len(lost),
        "pairs_lost_without": len(lost_without),
        "pairs_induced": len(lost - lost_without),
        "pairs_unresolved": len(lost & lost_without),
        "pairs_resolved": len(lost_without - lost),
    }
    if minima:
        nearest = minima[0]
        out["least_separation"], out["least_s"] = nearest.least_separation, nearest.t_s
        out["horizontal_m"], out["vertical_m"] = nearest.horizontal_m, nearest.vertical_m
    return out


def _lost(minima: list[PairMinimum] | tuple[PairMinimum, ...]) -> set[Pair]:
    return {minimum.pair for minimum in minima if minimum.lost}


def _arrival(monitor: ArrivalMonitor) -> dict[str, Any]:
    arrivals = monitor.arrivals()
    return {
        "due": sum(row.due for row in arrivals.rows),
        "not_arrived": len(arrivals.missing),
        "delay_mean_s": arrivals.delay_mean_s,
        "delay_max_s": arrivals.delay_max_s,
        "path_deviation_max_m": monitor.path_deviation_max_m,
    }
