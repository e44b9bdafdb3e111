"""Start-up time and memory of many UAV processes.

    python -m benchmarks.startup [--uavs 100] [--rounds 3]

Start-up is from the call of `run_fleet` to the end of the first tick: router, fork server, every
process connected and ready. Memory is each process's proportional set size (Linux).
"""

from __future__ import annotations

import argparse
import statistics
from pathlib import Path

from fleet.config.loading import read_scenario
from fleet.simulation.simulation import RunOptions, RunOutcome, run_fleet


def pss_mb(pid: int) -> float:
    """Proportional set size of a process, MB."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise ValueError(f"no Pss of process {pid}")


def main() -> None:
    """Start the fleet a few times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uavs", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    scenario = read_scenario(
        "crossing", [f"generate.count={options.uavs}", "duration_s=2"]
    ).scenario
    starts = []
    for n in range(options.rounds):
        sizes: list[float] = []

        def look(outcome: RunOutcome, sizes: list[float] = sizes) -> None:
            if outcome.ticks == 15:
                sizes += [pss_mb(pid) for pid in outcome.pids.values()]

        outcome = run_fleet(RunOptions(scenario), look)
        starts.append(outcome.start_s)
        print(
            f"round {n + 1}: {len(sizes)} processes ready in {outcome.start_s:.2f} s; PSS "
            f"median {statistics.median(sizes):.1f} MB, largest {max(sizes):.1f} MB; "
            f"{1e3 * outcome.wall_s / outcome.ticks:.0f} ms a tick",
            flush=True,
        )
    print(f"{options.uavs} UAVs: median start-up {statistics.median(starts):.2f} s")


if __name__ == "__main__":
    main()
