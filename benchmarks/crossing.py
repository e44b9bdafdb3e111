"""Random crossing traffic: separation and arrival with `geometric`, and without avoidance.

    python -m benchmarks.crossing [--seeds 20] [--uavs 30] [--density 0.25] [--jobs 2]

A run lasts twice as long as the flight across the box. Prints one line a seed, the totals, and
every unresolved encounter with its circumstances.
"""

from __future__ import annotations

import argparse
import math
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from benchmarks.flown import Outcome, Separation, Telling, undisturbed
from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.protocol.messages import Decision
from fleet.simulation.in_memory import run_in_memory
from fleet.transport.interface import ReceivedMessage

SPEED_MPS = 25.0
HEAD = (
    "| seed | `none`: lost pairs, least | lost pairs, least | arrived | delay mean, most "
    "| commands | terms | unresolved |\n" + "|---" * 8 + "|"
)


@dataclass(frozen=True)
class Result:
    """One seed, flown with the resolver and without."""

    seed: int
    flown: Outcome
    none: Separation
    terms: int
    unresolved: tuple[str, ...]


class Noting(Telling):
    """Keeps the unresolved encounters in words."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.unresolved: list[str] = []

    def note(self, item: ReceivedMessage, log_ns: int) -> None:
        """Look at every decision."""
        message = item[2]
        if isinstance(message, Decision):
            self.unresolved += [
                f"t={message.t_ns / 1e9:.1f} s, UAV {e.target}: {e.sector}, violation in "
                f"{e.time_to_violation_s:.1f} s, best option leaves {e.least_separation:.2f}"
                for e in message.encounters
                if e.stage == "least_bad"
            ]
        super().note(item, log_ns)


def one(job: tuple[int, int, float]) -> Result:
    """One seed."""
    seed, uavs, density = job
    side_m = 1000.0 * math.sqrt(uavs / density)
    settings = (
        f"seed={seed}",
        f"generate.count={uavs}",
        f"generate.density_per_km2={density}",
        f"generate.speed_mps={SPEED_MPS}",
        f"duration_s={round(2.0 * side_m / SPEED_MPS)}",
    )
    scenario = read_scenario("crossing", settings).scenario
    run_recorder = Noting(scenario)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    terms = len(run_recorder.tally.terms)
    return Result(
        seed, run_recorder.outcome(), undisturbed(scenario), terms, tuple(run_recorder.unresolved)
    )


def main() -> None:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--uavs", type=int, default=30)
    parser.add_argument("--density", type=float, default=0.25)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    jobs = [(seed, options.uavs, options.density) for seed in range(1, options.seeds + 1)]
    print(f"{options.uavs} UAVs at {options.density:g} per km^2, {options.seeds} seeds")
    print(HEAD)
    results = list[Result]()
    with ProcessPoolExecutor(options.jobs) as pool:
        for r in pool.map(one, jobs):
            results.append(r)
            print(_row(r), flush=True)
    for name, found in (
        ("none", [r.none for r in results]),
        ("geometric", [r.flown.separation for r in results]),
    ):
        lost, least = sum(len(s.lost) for s in found), min(s.least for s in found)
        print(f"{name}: {lost} pairs lost separation, least {least:.3f}")
    for r in results:
        for text in r.unresolved:
            print(f"seed {r.seed}: unresolved: {text}")


def _row(r: Result) -> str:
    rows, lost = r.flown.arrivals.rows, r.flown.separation
    delays = r.flown.arrivals.delays_s or [math.nan]
    cells = (
        r.seed,
        f"{len(r.none.lost)}, {r.none.least:.3f}",
        f"{len(lost.lost)}, {lost.least:.3f}",
        f"{len(rows) - len(r.flown.missing)} of {len(rows)}",
        f"{sum(delays) / len(delays):.1f}, {max(delays):.0f} s",
        sum(r.flown.commands.values()),
        r.terms,
        len(r.unresolved),
    )
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
