"""Imports the files of a folder, and holds their closest points against the files themselves.

    python -m benchmarks.foreign_encounters FOLDER...

For each file: UAVs, remarks, pairs, the least distance of a pair, and by how much time and distance
at the closest point of approach differ at most between the UAVs, flown by their plans through the
vehicle model, and `benchmarks.foreign_truth`, reckoned on the ellipsoid from the file. Distances
are compared in m for pairs that come nearer than 2 km, in per cent for others up to 50 km; times
where they are sharp: relative speed over 5 m/s, and not at the end.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.flown import path_of
from benchmarks.foreign_truth import STEP_S, Nearest, all_nearest, bluesky_paths, recorded_paths
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError
from fleet.imports.importing import SUFFIXES, import_traffic
from fleet.imports.scenario_making import ImportedTraffic
from fleet.model.types import Array

APART_M, NEAR_M = 50_000.0, 2_000.0
LONGEST_S = 2000.0


def flown_paths(made: ImportedTraffic, until_s: float) -> dict[str, Array]:
    """NED at every step of each UAV, by the name of the aircraft, if it is told nothing."""
    scenario: Scenario = made.scenario
    every = round(STEP_S / scenario.tick_s)
    pairs = zip(made.uavs, scenario.uav, strict=True)
    return {a.name: path_of(u, scenario, until_s).positions_ned_m[::every] for a, u in pairs}


def true_paths(file: Path, until_s: float) -> dict[str, Array]:
    """Of the file itself, by the upper-case names of BlueSky or those of the record."""
    return (bluesky_paths if file.suffix == ".scn" else recorded_paths)(file, until_s)


def compared(file: Path) -> tuple[ImportedTraffic, list[tuple[Nearest, Nearest]]]:
    """The import of a file, and of each pair the closest point by the file and by the import."""
    made = import_traffic(file)
    until_s = min(made.scenario.duration_s, LONGEST_S)
    truth = true_paths(file, until_s)
    flown = flown_paths(made, until_s)
    known = {name: np.where(np.isnan(truth[name]), np.nan, flown[name]) for name in flown}
    theirs = all_nearest({name: truth[name] for name in flown})
    ours = all_nearest(known)
    return made, [(theirs[pair], ours[pair]) for pair in theirs if pair in ours]


def row(file: Path) -> str:
    """A line of the table."""
    try:
        made, pairs = compared(file)
    except ScenarioError as error:
        why = str(error).partition("taken over: ")[2].partition(";")[0] or str(error)
        return f"| {file.name} | 0 | {why} | - | - | - | - | - |"
    near = [(a, b) for a, b in pairs if a.distance_m < APART_M]
    sharp = [(a, b) for a, b in near if a.sharp and b.sharp]
    differ = [(a.distance_m, abs(a.distance_m - b.distance_m)) for a, b in near]
    columns = (
        _greatest([-distance for distance, _ in differ], -1.0, 1),
        _greatest([abs(a.time_s - b.time_s) for a, b in sharp], 1.0, 3),
        _greatest([by for distance, by in differ if distance < NEAR_M], 1.0, 2),
        _greatest([100.0 * by / distance for distance, by in differ if distance >= NEAR_M], 1.0, 2),
    )
    told = " | ".join(columns)
    return f"| {file.name} | {len(made.uavs)} | {len(made.remarks)} | {len(near)} | {told} |"


def _greatest(values: Sequence[float], sign: float, digits: int) -> str:
    return f"{sign * max(values):.{digits}f}" if values else "-"


def main(arguments: Sequence[str]) -> None:
    """Print the table."""
    print("| file | UAVs | remarks | pairs | nearest, m | time, s | distance, m | distance, % |")
    print("|---|---|---|---|---|---|---|---|")
    for folder in arguments:
        for file in sorted(Path(folder).rglob("*")):
            if file.suffix in SUFFIXES:
                print(row(file), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
