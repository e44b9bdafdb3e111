"""Losses of separation in random crossing traffic: `geometric` against `none` on the same seeds.

    python -m benchmarks.crossing [--seeds 20] [--uavs 30] [--density 0.25] [--jobs 2]

Prints one line a seed, the totals, and every unresolved encounter with its circumstances.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

from fleet.comms.messages import Decision
from fleet.model.scenario import Scenario
from fleet.run.ledger import Item, Ledger
from fleet.run.memory import run_in_memory
from fleet.scenarios import load


@dataclass
class Result:
    """One run."""

    seed: int
    resolver: str
    lost_pairs: int
    least: float
    commands: int
    elections: int
    unresolved: list[str] = field(default_factory=list)


class Noting(Ledger):
    """Keeps the unresolved encounters in words."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario, None)
        self.unresolved: list[str] = []

    def note(self, item: Item, log_ns: int) -> None:
        """Look at every decision."""
        message = item[2]
        if isinstance(message, Decision):
            self.unresolved += [
                f"t={message.t_ns / 1e9:.1f} s, UAV {e.target}: {e.sector}, violation in "
                f"{e.time_to_violation_s:.1f} s, best option leaves {e.least_separation:.2f}"
                for e in message.encounters
                if e.unresolved
            ]
        super().note(item, log_ns)


def one(job: tuple[int, str, int, float]) -> Result:
    """One seed with one resolver."""
    seed, resolver, uavs, density = job
    settings = (
        f"seed={seed}",
        f"resolver={resolver}",
        f"generate.count={uavs}",
        f"generate.density_per_km2={density}",
    )
    ledger = Noting(load("crossing", settings).scenario)
    for _ in run_in_memory(load("crossing", settings).scenario, ledger):
        pass
    lost = sum(m.normalised < 1.0 for m in ledger.separation.minima())
    tally = ledger.tally
    return Result(
        seed,
        resolver,
        lost,
        ledger.separation.least(),
        len(tally.issued),
        len(tally.terms),
        ledger.unresolved,
    )


def main() -> None:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--uavs", type=int, default=30)
    parser.add_argument("--density", type=float, default=0.25)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    jobs = [
        (seed, resolver, options.uavs, options.density)
        for seed in range(1, options.seeds + 1)
        for resolver in ("none", "geometric")
    ]
    with ProcessPoolExecutor(options.jobs) as pool:
        results = list(pool.map(one, jobs))
    print(f"{options.uavs} UAVs at {options.density:g} per km^2, {options.seeds} seeds")
    print("seed | none: lost pairs, least | geometric: lost pairs, least, commands, unresolved")
    for none, geometric in zip(results[::2], results[1::2], strict=True):
        print(
            f"{none.seed:4d} | {none.lost_pairs:2d} {none.least:6.3f} | {geometric.lost_pairs:2d} "
            f"{geometric.least:6.3f} {geometric.commands:4d} {len(geometric.unresolved):3d}",
            flush=True,
        )
    for name in ("none", "geometric"):
        mine = [r for r in results if r.resolver == name]
        print(
            f"{name}: {sum(r.lost_pairs for r in mine)} pairs lost separation in {len(mine)} runs"
        )
    for r in results:
        for line in r.unresolved:
            print(f"seed {r.seed}: unresolved: {line}")


if __name__ == "__main__":
    main()
