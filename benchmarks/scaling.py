"""How the time of risk and resolution grows with the number of UAVs, at constant density.

    python -m benchmarks.scaling [--largest 256] [--rounds 3]

N UAVs of random crossing traffic form one group under one computing UAV; one round of the geometric
resolver decides for all of them, and one search of the coordinator looks at all pairs. Prints the
median times and the exponent p of a fit time ~ N^p, over all N and over the upper half.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

from fleet.agents.advisory import Aircraft, Situation
from fleet.agents.geometric import GeometricResolver
from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.tracks import StateReport


def report(uav: Uav, scenario: Scenario) -> StateReport:
    """What a UAV broadcasts at its start."""
    state, plan = uav.state(), uav.plan()
    pilot = scenario.pilot(uav.id, uav.speed_mps)
    return StateReport(uav.id, 0, state, pilot.intent(plan, state), pilot.ahead(plan, state))


def measure(count: int, rounds: int) -> tuple[float, float, int]:
    """Median seconds of one search and one round for N UAVs; and the commands of that round."""
    searches, resolutions, advised = [], [], 0
    for seed in range(rounds):
        scenario = read_scenario("crossing", [f"generate.count={count}", f"seed={seed}"]).scenario
        reports = [report(u, scenario) for u in uavs_of(scenario)]
        aircraft = tuple(Aircraft(r.id, r.state, r.guidance, None, r.plan) for r in reports)
        situation = Situation(1, tuple(r.id for r in reports), aircraft)
        resolver, outlook = GeometricResolver(scenario), scenario.outlook()
        begun = time.perf_counter()
        conflicts(reports, 0, outlook)
        searches.append(time.perf_counter() - begun)
        begun = time.perf_counter()
        advised += len(resolver.resolve(situation))
        resolutions.append(time.perf_counter() - begun)
    return statistics.median(searches), statistics.median(resolutions), advised


def exponent(counts: list[int], times: list[float]) -> float:
    """Slope of log time against log N."""
    return float(np.polyfit(np.log(counts), np.log(times), 1)[0])


def main() -> None:
    """Measure N = 2, 4, ... and fit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    measure(8, 1)
    counts, searches, resolutions = [], [], []
    count = 2
    while count <= options.largest:
        search, resolution, advised = measure(count, options.rounds)
        print(
            f"N = {count:4d}: search {1e3 * search:8.2f} ms, resolution {1e3 * resolution:8.2f} ms"
            f" ({advised} commands in {options.rounds} rounds)",
            flush=True,
        )
        counts.append(count)
        searches.append(search)
        resolutions.append(resolution)
        count *= 2
    upper = len(counts) // 2
    for name, times in (("search", searches), ("risk and resolution", resolutions)):
        print(
            f"{name}: time ~ N^{exponent(counts, times):.2f} over all N, "
            f"N^{exponent(counts[upper:], times[upper:]):.2f} from N = {counts[upper]}"
        )


if __name__ == "__main__":
    main()
