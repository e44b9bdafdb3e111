"""What a radio range spares: fleets of growing size at constant density, with and without it.

    python -m benchmarks.radio_range [--counts 50 100 200] [--range-m 3000] [--seconds 5]
                                     [--bus memory] [--rounds 3]

Random traffic at 0.25 UAVs per square km that elects among itself. Everything is as in `fleet run`
but for the log. Printed are, for a second of simulated time, messages received (by all together)
and time: in memory the least process time of all rounds, over zenoh the least wall time.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario
from fleet.simulation.simulation import RunOptions, run_fleet


def traffic(count: int, range_m: float | None, seconds: float) -> Scenario:
    """Random traffic of so many."""
    settings = {
        "generate.count": count,
        "duration_s": seconds,
        "coordination.electors": "local",
    }
    if range_m is not None:
        settings["surveillance.range_m"] = range_m
    return load_scenario("crossing", settings)


def flown(scenario: Scenario, bus: str) -> tuple[float, int]:
    """Time, and messages received, for a second of simulated time."""
    begun_s = time.process_time()
    outcome = run_fleet(RunOptions(scenario, bus=bus), lambda _: None)
    process_s = time.process_time() - begun_s
    assert outcome.status == "complete", outcome.why
    received = sum(n for (_, fate), n in outcome.run_recorder.tally.fates.items() if fate)
    spent_s = process_s if bus == "memory" else outcome.wall_s
    return spent_s / scenario.duration_s, round(received / scenario.duration_s)


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly all, without and with the range in turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=[50, 100, 200])
    parser.add_argument("--range-m", type=float, default=3000.0)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--bus", choices=("memory", "zenoh"), default="memory")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args(arguments)
    print("| UAVs | radio range | received in a second | time for a second |\n|---|---|---|---|")
    for count in options.counts:
        for range_m in (None, options.range_m):
            scenario = traffic(count, range_m, options.seconds)
            found = [flown(scenario, options.bus) for _ in range(options.rounds)]
            told = "none" if range_m is None else f"{range_m:g} m"
            print(f"| {count} | {told} | {found[0][1]} | {min(found)[0]:.3f} s |", flush=True)


if __name__ == "__main__":
    main()
