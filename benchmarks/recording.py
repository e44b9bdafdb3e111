"""What recording costs: lockstep runs over zenoh with a log, beside the same runs without one.

    python -m benchmarks.recording [SCENARIO ...] [--rounds 9] [--duration 60]

The two are run in turn, each first in every other round, so that a noisy machine is noisy for both.
What is compared is the wall time of all ticks; starting the fleet does not count.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.simulation.simulation import RunOptions, run_fleet

DEFAULT = ("four_way", "crossing")


def tick_s(scenario: Scenario, out: Path | None) -> float:
    """Wall seconds a tick."""
    outcome = run_fleet(RunOptions(scenario, out=out, force=True), lambda _: None)
    return outcome.wall_s / outcome.ticks


def main() -> None:
    """Run with and without, and print the medians and the median of the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=DEFAULT)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--duration", type=float, default=60.0)
    options = parser.parse_args()
    print("| scenario | recording, ms a tick | not recording, ms a tick | ratio (quartiles) |")
    print("|---|---|---|---|")
    for name in options.scenarios:
        scenario = read_scenario(name, [f"duration_s={options.duration}"]).scenario
        on: list[float] = []
        off: list[float] = []
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "run.mcap"
            tick_s(scenario, None)  # the first run of a process imports what the others find
            for n in range(options.rounds):
                for recording in (n % 2 == 0, n % 2 != 0):
                    (on if recording else off).append(tick_s(scenario, log if recording else None))
        ratios = [a / b for a, b in zip(on, off, strict=True)]
        low, ratio, high = statistics.quantiles(ratios, n=4)
        on_ms, off_ms = 1e3 * statistics.median(on), 1e3 * statistics.median(off)
        print(
            f"| `{name}` | {on_ms:.2f} | {off_ms:.2f} | {ratio:.3f} ({low:.3f} to {high:.3f}) |",
            flush=True,
        )


if __name__ == "__main__":
    main()
