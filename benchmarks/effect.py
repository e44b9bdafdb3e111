"""What latency and loss do: separation and arrival over a grid of both, on the in-memory bus.

    python -m benchmarks.effect [SCENARIO ...] [--seeds 3] [--set KEY=VALUE ...]
        [--latencies 0 0.2 ...] [--losses 0 0.1 ...]

For every cell: the least normalised separation over all seeds, in how many of the runs any pair
lost separation, and in how many not everybody has arrived at the end. Loss draws are nested: what
is lost at 10 percent is lost at 30 percent too.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor

from benchmarks.flown import Outcome, fly
from fleet.config.loading import read_scenario, with_faults

LATENCIES_S = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)
LOSSES = (0.0, 0.1, 0.3, 0.5, 0.8)


def one(name: str, settings: list[str], latency_s: float, loss: float, seed: int) -> Outcome:
    """What comes of one run."""
    faults = [
        {"kind": "latency", "base_s": latency_s},
        {"kind": "loss", "probability": loss},
    ]
    return fly(with_faults(read_scenario(name, [*settings, f"seed={seed}"]).scenario, faults, name))


def main() -> None:
    """Fly the grid and print a table for every scenario."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=["head_on", "four_way"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--latencies", type=float, nargs="*", default=LATENCIES_S)
    parser.add_argument("--losses", type=float, nargs="*", default=LOSSES)
    parser.add_argument("--set", dest="settings", action="append", default=[])
    options = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        for name in options.scenarios:
            print(f"\n{name}, {options.seeds} seeds, {' '.join(options.settings) or 'defaults'}")
            print("| latency | " + " | ".join(f"loss {loss:.0%}" for loss in options.losses) + " |")
            print("|---" * (len(options.losses) + 1) + "|")
            for latency_s in options.latencies:
                jobs = [
                    [
                        pool.submit(one, name, options.settings, latency_s, loss, seed)
                        for seed in range(1, options.seeds + 1)
                    ]
                    for loss in options.losses
                ]
                cells = []
                for row in jobs:
                    found = [job.result() for job in row]
                    least = min(o.separation.least for o in found)
                    lost = sum(bool(o.separation.lost) for o in found)
                    missing = sum(bool(o.missing) for o in found)
                    cells.append(f"{least:.2f} ({lost}, {missing})")
                print(f"| {latency_s:g} s | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
